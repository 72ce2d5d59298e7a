"""How true the PSFs are that bright points give, over the distances of a lens.

python -m pytest -m benchmark tests/benchmarks/test_point_target.py -s
"""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
from test_target_point import LAB, shots

from calib.targets.point import Point
from psflut.imagers.plain import Plain
from psflut.optics import blur_radius
from psflut.psfs.pupil import Pupil

pytestmark = pytest.mark.benchmark


def test_twenty_distances(rng):
    """32 points a distance, 12 bits, read and shot noise; blur radii from 11.6 to 0.4 pixels."""
    rows = []
    for distance in 1 / np.linspace(1 / 0.8, 1 / 5.0, 20):
        radius = abs(float(blur_radius(LAB, distance))) / LAB.pixel_pitch
        size = 2 * int(np.ceil(1.5 * radius)) + 13
        truth = Pupil()(LAB, distance, size)
        found = Point().measure(shots(distance, size, rng, points=4), size, Plain())
        off = found.psf - truth / truth.sum()
        rows.append((np.abs(off).sum(), np.sqrt(np.mean((off / found.std) ** 2))))
        print(
            f"\n{distance:.2f} m, radius {radius:4.1f} px: L1 {rows[-1][0]:.3f}, errors / stated {rows[-1][1]:.2f}",
            end="",
        )
    wrong, honest = np.array(rows).T
    print(f"\nmean L1 {wrong.mean():.3f}; errors / stated, root mean square {np.sqrt(np.mean(honest**2)):.2f}")
    assert wrong.mean() < 0.05
    assert 1 / 1.3 < np.sqrt(np.mean(honest**2)) < 1.3
