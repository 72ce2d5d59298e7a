"""Where what a report says comes from: the patch, the table, the software; and how to cite it."""

import hashlib
import json
import os
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from psflut import __version__, texture
from psflut.estimation import Estimate, Observation
from psflut.summary import summarise, words
from psflut.table import PSFTable

LIBRARIES = ("numpy", "scipy", "emcee", "matplotlib")


def provenance(
    observation: Observation, table: PSFTable, found: Estimate, about: Mapping[str, str]
) -> dict[str, list[tuple[str, str]]]:
    """Rows of (name, words) under headings: the patch, the table, the software."""
    image = np.ascontiguousarray(observation.image, dtype="<f8")
    psfs = np.concatenate([table.axis.ravel(), table.psf.ravel()]).astype("<f4")
    noise = f"read {found.stats['noise']:.4g}, from: {found.stats['noise_source']}"
    software = [("psflut", __version__), ("Python", platform.python_version())]
    software += [(name, version(name)) for name in LIBRARIES]
    if "SOURCE_DATE_EPOCH" in os.environ:
        day = datetime.fromtimestamp(int(os.environ["SOURCE_DATE_EPOCH"]), UTC)
        software.append(("date", day.date().isoformat()))
    return {
        "The patch": [
            *about.items(),
            ("pixels", f"{image.shape[0]} x {image.shape[1]}"),
            ("noise", noise),
            ("sha256 of its values", _sha256(image)),
        ],
        "The table": [
            *words(summarise(table)),
            ("sha256 of distances and PSFs", _sha256(psfs)),
            ("provenance", json.dumps(dict(table.provenance), sort_keys=True)),
        ],
        "The software": [
            *software,
            ("prior of scenes", json.dumps(dict(texture.learnt().provenance), sort_keys=True)),
        ],
    }


def _sha256(values: NDArray[np.floating]) -> str:
    return hashlib.sha256(values.tobytes()).hexdigest()


def citations() -> list[str]:
    """What to name in a text that uses the report."""
    return [
        f"The psflut developers. psflut {__version__}: distance from blur, with error bars (software).",
        "D. Foreman-Mackey, D. W. Hogg, D. Lang, J. Goodman. emcee: The MCMC Hammer. Publications of the Astronomical "
        "Society of the Pacific 125, 306 (2013).",
    ]
