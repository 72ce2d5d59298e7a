"""What a table holds, as plain facts for JSON and as words for a person."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from psflut.optics import blur_radius
from psflut.sampling import advice
from psflut.table import PSFTable
from psflut.units import format_length


def summarise(table: PSFTable) -> dict[str, Any]:
    """Facts about a table, in metres and image units; plain JSON."""
    facts: dict[str, Any] = {
        "axis": table.kind,
        "span_m": list(table.span),
        "planes": len(table.axis),
        "size_px": table.size,
        "pixel_pitch_m": table.pixel_pitch,
        "modes": 0 if table.psf_modes is None else len(table.psf_modes),
        "peak": [float(plane.max()) for plane in table.psf[[0, -1]]],
        "camera": None,
        "imager": table.imager,
        "noise": dataclasses.asdict(table.noise) if table.noise else None,
        "check": table.check,
        "sampling": advice(table),
        "provenance": dict(table.provenance),
    }
    if table.camera is not None:
        focus = table.camera.focus_distance
        radius = np.abs(blur_radius(table.camera, table.axis)) / table.pixel_pitch
        facts["camera"] = {
            **dataclasses.asdict(table.camera),
            "f_number": table.camera.f_number,
            "focus_distance": focus if np.isfinite(focus) else None,
        }
        facts["blur_radius_px"] = [float(radius.min()), float(radius.max())]
    return facts


def words(facts: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The facts as rows of (name, words)."""
    near, far = (format_length(z) for z in facts["span_m"])
    size = facts["size_px"]
    rows = [
        ("axis", f"{facts['axis']}, {near} to {far}, {facts['planes']} planes"),
        ("psf", f"{size} x {size} pixels of {format_length(facts['pixel_pitch_m'])}"),
        ("imager", facts["imager"]),
        ("noise", _noise(facts)),
        *([("planes", facts["sampling"])] if facts["sampling"] else []),
        *_check(facts),
    ]
    camera = facts["camera"]
    if camera is not None:
        focus = camera["focus_distance"]
        low, high = facts["blur_radius_px"]
        rows[1:1] = [
            (
                "camera",
                f"{format_length(camera['focal_length'])} f/{camera['f_number']:.3g}, focused at "
                f"{'infinity' if focus is None else format_length(focus)}, "
                f"{format_length(camera['wavelength'])}",
            ),
            ("blur", f"geometric radius {low:.2f} to {high:.2f} pixels"),
        ]
    made = facts["provenance"]
    if "target" in made:
        used, rejected = sum(made["used"]), len(made["rejected"])
        rows.append(("measured", f"{made['target']}, {made['frames']} frames, {used} used and {rejected} rejected"))
    if facts["modes"]:
        rows.append(("modes", f"{facts['modes']}, of how {made.get('modes_from', 'its')} points differ"))
    if "model" in made:
        settings = [f"{key} {_spell(key, value)}" for key, value in made["settings"].items() if value]
        rows.append(("model", ", ".join([made["model"], *settings])))
    return rows


def _spell(setting: str, value: Any) -> str:
    if isinstance(value, list):
        return " ".join(_spell(setting, item) for item in value)
    return format_length(value) if setting == "wavelengths" else str(value)


def _check(facts: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What calibration said of the table: held-out errors, placement, ranges, model; a row for each that is there."""
    check = facts["check"] or {}
    rows = []
    if "errors_m" in check:
        left_out = f"{check['held_out_positions']} positions left out once"
        error, shape = format_length(check["position_error_m"]), check["psf_error"]
        if check.get("position_error_of_distance") is not None:
            error += f" or {check['position_error_of_distance']:.2%} of the distance"
        noisy = f"PSFs differ by {shape:.1%}, their noise included"
        rows.append(("check", f"{left_out}: median error to expect {error}; {noisy}"))
    if "placement_m" in check:
        sigma = check["placement_m"]
        rows.append(("placement", f"sigma {format_length(sigma)}" if sigma else "no error seen beside those of PSFs"))
    if "ranges" in check:
        ranges = check["ranges"]
        words = [f"{name} {_spans(ranges[f'{name}_m'])}" for name in ("good", "blind") if ranges[f"{name}_m"]]
        limit = f"{ranges['good_below']:.0%} of {ranges['of']} or better"
        seen = f"a point {ranges['snr']:g} times above the noise"
        rows.append(("range", f"{', '.join(words)} (good: {limit}, of {seen})"))
    if "model" in check:
        rows.append(("pupil", _model(check["model"])))
    return rows or [("check", "none")]


def _spans(spans: Sequence[Sequence[float]]) -> str:
    return " and ".join(f"from {format_length(near)} to {format_length(far)}" for near, far in spans)


def _model(model: Mapping[str, Any]) -> str:
    square = model["chi_square"]
    names = {"pupil": "the pupil model", "both": "the model with the course", "course": "the measured course"}
    better, beside = names[model["better"]], f", {square['both']:.3g} of both" if "both" in square else ""
    focus = "beyond infinity" if model["focus_m"] is None else f"at {format_length(model['focus_m'])}"
    lens = f"focus {focus}, {model['spherical_waves']:+.3f} waves of spherical aberration"
    squares = f"chi-square {square['pupil']:.3g} of the model, {square['course']:.3g} of the course{beside}"
    return f"{better} explains held-out PSFs best: {squares}; {lens}"


def _noise(facts: Mapping[str, Any]) -> str:
    noise, why = facts["noise"], facts["provenance"].get("noise_unknown", "")
    if noise is None:
        return f"not known: {why}" if why else "not known"
    shot = f", {noise['gain']:.0f} photo-electrons at full scale" if noise["gain"] else ""
    return f"read {noise['read']:.4g}{shot}"
