"""What `psflut depthmap` says of a map: JSON objects of its patches, or a row a frame."""

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from psflut.cli import console

if TYPE_CHECKING:
    from psflut.depthmaps import DepthMap


def say(names: Sequence[str], found: "DepthMap", as_json: bool) -> None:
    """JSON of every patch; or for a person a row a frame, and what the outcomes mean."""
    from psflut.batch import OUTCOMES

    rows: list[tuple[str, ...]] = [("image", "patches", "sure", "5 %", "median", "95 %", "outcomes")]
    for number, name in enumerate(names):
        one = found.frame(number)
        if as_json:
            for record in _records(name, one):
                print(json.dumps(record))
            continue
        quantiles = (f"{z:.3f} m" for z in _quantiles(one))
        outcomes = ", ".join(f"{count} {outcome}" for outcome, count in one.counts().items() if count)
        rows.append((name, " x ".join(map(str, one.distance.shape)), f"{one.sure.mean():.0%}", *quantiles, outcomes))
    if not as_json:
        console.print_rows(rows)
        for outcome in OUTCOMES:
            if outcome.value and found.counts()[outcome.name.lower()]:
                console.say(f"{outcome.name.lower()}: {outcome.value}")


def _quantiles(found: "DepthMap") -> list[float]:
    """Of the sure patches' distances, of all where none is sure."""
    import numpy as np

    distance = found.distance[found.sure] if found.sure.any() else found.distance
    return [float(z) for z in np.quantile(distance, [0.05, 0.5, 0.95])]


def _records(name: str, found: "DepthMap") -> list[dict[str, Any]]:
    """The JSON objects of a frame's patches: y, x of the centre in pixels, lengths in metres; null for no misfit."""
    import numpy as np

    from psflut.batch import OUTCOMES

    records = []
    for row, column in np.ndindex(found.distance.shape):
        at, misfit = (row, column), float(found.misfit[row, column])
        record = {
            "image": name,
            "y": float(found.y[row]),
            "x": float(found.x[column]),
            "distance_m": float(found.distance[at]),
            "interval_m": found.interval[at].tolist(),
            "wide_m": found.wide[at].tolist(),
            "level": found.about["level"],
            "outcome": OUTCOMES[found.outcome[at]].name.lower(),
            "misfit": misfit if np.isfinite(misfit) else None,
        }
        smooth = {} if found.smooth is None else {"smooth_m": float(found.smooth[at])}
        records.append(record | smooth)
    return records
