"""A map of distances: every patch of an image, or of a sequence of them, with interval and outcome."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psflut.batch import OUTCOMES
from psflut.card import card
from psflut.errors import PsflutError
from psflut.units import format_length

Floats = NDArray[np.float64]

SURE = 0.5
"""A patch is uncertain where its outcome is not OK, or its wide interval more than this share of its distance; on a
stage axis, of the table's span."""


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Distances of overlapping patches; arrays (ny, nx), or (T, ny, nx) of a sequence.

    Parameters
    ----------
    y, x : (ny,), (nx,) arrays
        Pixel coordinates of the patches' centres.
    distance : array
        Metres; finite in every outcome.
    interval : array (..., 2)
        Near and far end, metres, as `estimate` has them for a patch that is one surface.
    wide : array (..., 2)
        The same, widened by how much neighbouring patches differ (`psflut.relief`): for patches that may straddle
        several surfaces.
    outcome : array of int8
        Places in `psflut.batch.OUTCOMES`; 0 is OK.
    misfit : array
        As `psflut.evidence.misfit`; NaN where the patch is FLAT.
    smooth : array or None
        Distances smoothed across neighbours (`psflut.smoothing`), metres. Nothing else changes with it.
    time : (T,) array or None
        Of the frames: numbers, or seconds where their rate is known.
    about : mapping
        What made the map; plain JSON.
    """

    y: Floats
    x: Floats
    distance: Floats
    interval: Floats
    wide: Floats
    outcome: NDArray[np.int8]
    misfit: Floats
    smooth: Floats | None
    time: Floats | None
    about: Mapping[str, Any]

    @property
    def sure(self) -> NDArray[np.bool_]:
        """Where the outcome is OK and the wide interval narrow enough to go by (`SURE`)."""
        width = np.ptp(self.wide, axis=-1)
        scale = self.distance if self.about["axis"] == "distance" else np.ptp(self.about["span_m"])
        return np.asarray((self.outcome == 0) & (width <= SURE * scale))

    def frame(self, number: int) -> "DepthMap":
        """One frame of a sequence."""
        if self.time is None:
            return self
        parts = {name: getattr(self, name)[number] for name in ("distance", "interval", "wide", "outcome", "misfit")}
        smooth = None if self.smooth is None else self.smooth[number]
        return DepthMap(self.y, self.x, **parts, smooth=smooth, time=None, about=self.about)

    def variables(self) -> dict[str, tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]]:
        """Name, dimensions, values and CF attributes of all that a file of the map holds."""
        plane = ("y", "x") if self.time is None else ("time", "y", "x")
        what = "distance" if self.about["axis"] == "distance" else "stage coordinate"
        lengths = {
            "distance": (self.distance, f"{what} of the patch"),
            "near": (self.interval[..., 0], "lower end of the interval of the patch alone"),
            "far": (self.interval[..., 1], "upper end of the interval of the patch alone"),
            "near_wide": (self.wide[..., 0], "lower end, counting how neighbouring patches differ"),
            "far_wide": (self.wide[..., 1], "upper end, counting how neighbouring patches differ"),
        }
        if self.smooth is not None:
            lengths["distance_smooth"] = (self.smooth, f"{what}, smoothed across neighbouring patches")
        found: dict[str, tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]]
        found = {name: (plane, values, {"units": "m", "long_name": words}) for name, (values, words) in lengths.items()}
        names = [outcome.name.lower() for outcome in OUTCOMES]
        flags: dict[str, Any] = {"flag_values": list(range(len(names))), "flag_meanings": " ".join(names)}
        found["outcome"] = (plane, self.outcome, {"long_name": "how the estimate went", **flags})
        found["misfit"] = (plane, self.misfit, {"units": "1", "long_name": "deviance an annulus of the spectrum"})
        for name, values, words in (("y", self.y, "row"), ("x", self.x, "column")):
            found[name] = ((name,), values, {"units": "1", "long_name": f"{words} of the patch's centre, pixels"})
        if self.time is not None:
            words = "frame" if self.about["rate"] is None else "time since the first frame"
            found["time"] = (("time",), self.time, {"units": "1" if words == "frame" else "s", "long_name": words})
        return found

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` of it, with dimensions, units and attributes as in the Zarr file."""
        try:
            import xarray
        except ImportError as error:
            raise PsflutError("to_xarray needs xarray; install it with: pip install psflut[lab]") from error
        return xarray.Dataset(self.variables(), attrs=dict(self.about))

    def figure(self, image: NDArray[np.floating] | None = None) -> Any:
        """The map beside its scene, uncertain patches greyed out; of a sequence, its first frame."""
        from psflut.plots import depthmap  # only who looks pays for matplotlib

        one = self.frame(0)
        if one.smooth is not None:
            return depthmap(one.smooth, one.sure, one.about, image, "distance, smoothed")
        return depthmap(one.distance, one.sure, one.about, image)

    def counts(self) -> dict[str, int]:
        """Patches by outcome."""
        return {outcome.name.lower(): int(np.sum(self.outcome == k)) for k, outcome in enumerate(OUTCOMES)}

    def _repr_html_(self) -> str:
        """A card, for a notebook."""
        near, middle, far = (format_length(float(z)) for z in np.quantile(self.distance, [0.05, 0.5, 0.95]))
        rows = [("patches", " x ".join(map(str, self.distance.shape))), ("5 to 95 % of them", f"{near} to {far}")]
        rows += [(name.replace("_", " "), str(count)) for name, count in self.counts().items() if count]
        return card(f"median {middle}", [*rows, ("sure", f"{self.sure.mean():.0%}")])
