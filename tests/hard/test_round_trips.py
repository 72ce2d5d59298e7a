"""Tables through their own API, xarray and zarr and back, whatever they hold; and read by the newest zarr.

    python -m pytest -m campaign tests/hard/test_round_trips.py
    PSFLUT_NEWEST_ZARR=PYTHON python -m pytest tests/hard/test_round_trips.py -k newest -s

PYTHON is an interpreter in which the newest zarr is installed (zarr 3.2 wants Python 3.12).
"""

import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest
import xarray
import zarr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from psflut import layout, store
from psflut.noise import Noise
from psflut.optics import Camera
from psflut.table import PSFTable

LENGTHS = st.floats(1e-6, 10.0)
WORDS = st.dictionaries(
    st.text(max_size=6), st.text(max_size=6) | st.integers() | st.booleans() | st.none(), max_size=3
)


@st.composite
def tables(draw):
    """Any table that may be: of either axis, with and without what is optional."""
    count, size = draw(st.integers(3, 6)), draw(st.sampled_from([3, 5, 7]))
    kind = draw(st.sampled_from(["distance", "stage"]))
    rng, pitch = np.random.default_rng(draw(st.integers(0, 2**32))), draw(st.floats(1e-7, 1e-3))
    steps = np.array(draw(st.lists(st.floats(1e-6, 10.0), min_size=count, max_size=count)))
    psf = rng.random((count, size, size)) ** draw(st.sampled_from([1, 8]))
    psf /= psf.sum(axis=(1, 2), keepdims=True)
    optional = st.booleans()
    focal = draw(LENGTHS)
    return PSFTable(
        axis=np.cumsum(steps) - (5.0 if kind == "stage" else 0.0),
        psf=psf,
        pixel_pitch=pitch,
        kind=kind,
        camera=Camera(focal, draw(LENGTHS), focal * draw(st.floats(1.0, 3.0)), pitch) if draw(optional) else None,
        imager=draw(st.sampled_from(["plain", "laplacian:0.5", "dog", "dog:2.0:3.0"])),
        noise=Noise(draw(LENGTHS), draw(st.none() | LENGTHS), draw(LENGTHS)) if draw(optional) else None,
        psf_std=0.1 * psf if draw(optional) else None,
        axis_std=0.01 * steps if draw(optional) else None,
        psf_modes=rng.standard_normal((2, *psf.shape)) if draw(optional) else None,
        provenance=draw(WORDS),
        check=draw(st.none() | WORDS),
    )


def assert_same(one, other):
    first, second = layout.arrays_of(one), layout.arrays_of(other)
    assert first.keys() == second.keys()
    for name in first:
        np.testing.assert_allclose(first[name], second[name], rtol=3e-7, atol=0, err_msg=name)
    assert layout.attributes_of(one) == layout.attributes_of(other)


def round_trip(examples):
    """Take so many tables there and back."""

    @settings(max_examples=examples, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
    @given(tables(), st.sampled_from([".zarr", ".zarr.zip"]))
    def there_and_back(table, ending):
        go(table, ending)

    there_and_back()


def test_own_api_xarray_zarr_and_back():
    round_trip(6)


@pytest.mark.campaign
def test_two_hundred_tables_there_and_back():
    round_trip(200)


def go(table, ending):
    """Own API, own file, own API, xarray, its file, own API and zarr: the same all the way."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        store.write_table(table, folder / f"t{ending}")
        back = store.read_table(folder / f"t{ending}")
        assert_same(table, back)
        store.write_table(back, folder / "again.zarr")
        seen = xarray.open_zarr(folder / "again.zarr", consolidated=False).load()
        seen.to_zarr(folder / "seen.zarr", consolidated=False, zarr_format=3)
        assert_same(back, store.read_table(folder / "seen.zarr"))
        group = zarr.open_group(folder / "seen.zarr", mode="r")
        np.testing.assert_array_equal(group["psf"][:], seen.psf.values)


READ = """
import sys, warnings, hashlib, numpy, zarr
warnings.simplefilter("ignore")
path = sys.argv[1]
group = zarr.open_group(zarr.storage.ZipStore(path, mode="r") if path.endswith(".zip") else path, mode="r")
sums = group.attrs["sha256"]
for name, array in group.arrays():
    values = numpy.ascontiguousarray(array[:])
    assert hashlib.sha256(values.tobytes()).hexdigest() == sums[name], name
assert dict(group.attrs)["complete"] is True
print(zarr.__version__, len(list(group.arrays())), "arrays as they were")
"""


@pytest.mark.parametrize("ending", [".zarr", ".zarr.zip"])
def test_the_newest_zarr_reads_it(small, tmp_path, ending):
    python = os.environ.get("PSFLUT_NEWEST_ZARR")
    if python is None:
        pytest.skip("set PSFLUT_NEWEST_ZARR to a Python with the newest zarr")
    store.write_table(small, tmp_path / f"t{ending}")
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    done = subprocess.run(
        [python, "-c", READ, tmp_path / f"t{ending}"], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr
    print(done.stdout)
