"""What the PSFs of a table cost beside the same ones by prysm, timed in the same run, and the memory of each.

    python -m pytest -m benchmark tests/benchmarks/test_build_speed.py -s

Distances of lab16mm, white light (five wavelengths), as its recipe has them; `tests/test_psf_pupil.py` shows that the
two agree. prysm cuts a pixel into parts, as psflut does by a transfer function; with 21 x 21 of them it is as near as
it comes, 7 x 7 leave about what psflut leaves.
"""

import numpy as np
import pytest
import test_psf_pupil
from test_psf_pupil import prysm_psf
from test_speed import peak, seconds

from psflut.psfs.pupil import Pupil

pytestmark = pytest.mark.benchmark
WAVELENGTHS, DISTANCES, SIZE = tuple(np.linspace(470e-9, 630e-9, 5)), (0.9, 1.4, 2.6), 49


@pytest.mark.parametrize("parts", [21, 7])
def test_the_planes_of_a_table(lab16mm, parts, monkeypatch):
    monkeypatch.setattr(test_psf_pupil, "SUBDIVIDED", parts)
    camera, pupil = lab16mm.camera, Pupil(wavelengths=WAVELENGTHS)

    def ours():
        return [pupil(camera, z, SIZE) for z in DISTANCES]

    def theirs():
        return [prysm_psf(camera, z, SIZE, (), WAVELENGTHS) for z in DISTANCES]

    apart = max(np.abs(a - b).max() / b.max() for a, b in zip(ours(), theirs(), strict=True))
    mine, reference = (seconds(work, rounds=3) for work in (ours, theirs))
    print(f"\na plane: {1e3 * mine / len(DISTANCES):.0f} ms, {reference / mine:.1f} times as fast as prysm", end=" ")
    print(f"({parts} x {parts} parts a pixel), apart by {apart:.1e} of the peak;", end=" ")
    print(f"{peak(ours):.0f} MB, {peak(theirs):.0f} MB")
    assert apart < 0.01
