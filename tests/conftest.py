"""What the tests share: shipped tables, sharp photographs, captures that no table made."""

import functools
import os
import sys

import numpy as np
import pytest
import typer.main

from psflut import capture, cli, store
from psflut.demo import photograph


def pytest_xdist_auto_num_workers(config):
    """Benchmarks run one after the other: they print what they find, and time it. Else one thread a worker."""
    if config.option.markexpr == "benchmark":
        return 0
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    return os.cpu_count()


COMPILE_NOTHING = ("test_check", "test_lens_course", "test_noise_target", "test_target_")
"""Files of tests that call no compiled loops, half a minute of them."""


@pytest.hookimpl(trylast=True)  # when campaigns are left out
def pytest_collection_modifyitems(items):
    """Of two workers the second begins with what compiles nothing, so that only the first compiles, and keeps it."""
    first = [item for item in items if not item.path.name.startswith(COMPILE_NOTHING)]
    then = [item for item in items if item.path.name.startswith(COMPILE_NOTHING)]
    half = len(items) // 2
    items[:] = first[:half] + then + first[half:]


@pytest.fixture(scope="session", autouse=True)
def one_parser():
    """The parser of the command line is made once, not for each of a thousand commands: 25 ms each."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", functools.cache(typer.main.get_command))
        yield


@pytest.fixture(scope="session")
def run():
    """Run a command: its exit code."""

    def run(*words):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", ["psflut", *map(str, words)])
            with pytest.raises(SystemExit) as done:
                cli.main()
        return done.value.code

    return run


@pytest.fixture(scope="session")
def lab16mm():
    return store.read_table("lab16mm")


@pytest.fixture(scope="session")
def thesis():
    return store.read_table("thesis")


@pytest.fixture(scope="session")
def scene():
    """A sharp photograph, (256, 256)."""
    return photograph()


@pytest.fixture(scope="session")
def lab_patch(lab16mm, scene):
    """A (128, 128) patch at 1.63 m through lab16mm, read noise 0.005: from the model, off the table's grid."""
    setup = capture.Setup(noise="0.005")
    return capture.simulate(scene, lab16mm, 1.63, setup, seed=1)[0][64:192, 64:192]


@pytest.fixture(scope="session")
def big():
    """A sharp photograph, (256, 256), larger than what is captured of it."""
    from skimage import data

    return data.camera()[::2, ::2] / 255.0


@pytest.fixture
def rng():
    return np.random.default_rng(20260101)
