"""The whole command: help, version, mistakes, and readers that leave."""

import subprocess
import sys
import time

import pytest

from psflut import __version__


def test_help_and_version(psflut):
    assert psflut("--version") == (0, f"{__version__}\n", "")
    code, out, err = psflut("--help")
    assert (code, err) == (0, "")
    commands = ("demo", "build", "info", "simulate", "estimate")
    assert all(f"\n  {name} " in out for name in commands)
    assert psflut() == (code, out, err)  # nothing asked: the same help
    for name in commands:
        code, out, _ = psflut(name, "--help")
        assert code == 0
        assert out.startswith(f"Usage: psflut {name}")


def run_python(code):
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return time.perf_counter() - start, done.stdout


def test_help_costs_little_more_than_the_library_that_prints_it():
    asked = (
        "import sys; sys.argv = ['psflut', '--help']; import atexit, psflut.cli\n"
        "heavy = 'numpy scipy zarr pydantic matplotlib emcee skimage imageio tqdm'.split()\n"
        "atexit.register(lambda: print('heavy:', *[m for m in heavy if m in sys.modules]))\n"
        "psflut.cli.main()"
    )
    bare = min(run_python("import typer")[0] for _ in range(2))
    spent, out = min(run_python(asked) for _ in range(2))
    assert out.endswith("heavy:\n")
    assert spent < 6 * bare


def test_a_reader_that_leaves_early_is_no_error(shelf):
    code = "import sys; sys.argv[1:] = ['info', 'lab16mm', '--json']; from psflut.cli import main; main()"
    run = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    run.stdout.close()
    assert run.stderr.read() == ""
    run.stderr.close()
    assert run.wait() == 1


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["estimat"], "estimate"),
        (["--verbose"], "--verbose"),
        (["estimate", "--table", "lab16mm"], "IMAGE"),
        (["estimate", "a.tif"], "--table"),
        (["estimate", "a.tif", "--tabel", "lab16mm"], "--tabel"),
        (["estimate", "a.tif", "--table", "lab16mm", "--level", "high"], "--level"),
        (["estimate", "a.tif", "--table", "lab16mm", "--noise"], "--noise"),
        (["simulate", "a.png", "--camera", "c.toml", "-o", "o.tif"], "--distance"),
        (["simulate", "a.png", "--camera", "c.toml", "--distance", "1 m"], "--output"),
        (["build"], "RECIPE"),
        (["info"], "TABLE"),
    ],
)
def test_a_mistake_in_the_command_points_to_its_help(refused, words, sentence):
    err = refused(*words)
    assert sentence in err
    assert "--help'" in err
