"""Mistakes at a prompt: one sentence, exit 2, no traceback, nothing left behind; streams closed, Ctrl-C."""

import signal
import subprocess
import sys

import numpy as np
import pytest

from psflut import cli
from psflut.writing import write_tiff

PROMPT = [sys.executable, "-c", "from psflut.cli import main; main()"]

MISTAKES = {  # words, and a word that the sentence must have
    "an unknown command": ("estimat shot.tif", "estimat"),
    "an unknown option": ("estimate shot.tif --tabel lab16mm", "--tabel"),
    "an unknown table": ("estimate shot.tif --table lab17mm", "lab17mm"),
    "an image for a table": ("info shot.tif", "shot.tif"),
    "a table for an image": ("estimate table.toml --table lab16mm", "table.toml"),
    "no such image": ("estimate shut.tif --table lab16mm", "shut.tif"),
    "a folder for an image": ("estimate . --table lab16mm", "image"),
    "a patch outside": ("estimate shot.tif --table lab16mm --patch 90,90,64", "90,90,64"),
    "a level of 2": ("estimate shot.tif --table lab16mm --level 2", "--level"),
    "negative noise": ("estimate shot.tif --table lab16mm --noise -1", "noise"),
    "an unknown method": ("estimate shot.tif --table lab16mm --method weiner", "weiner"),
    "a stride of 0": ("depthmap shot.tif --table lab16mm --stride 0 -o map.zarr", "stride"),
    "a map that is no map": ("depthmap shot.tif --table lab16mm -o map.docx", "map.docx"),
    "a recipe without units": ("build table.toml -o new.zarr", "unit"),
    "captures that are none": ("calibrate table.toml --target point --pixel-pitch 6um -o new.zarr", "table.toml"),
}


@pytest.fixture
def shots(desk):
    """The desk with a capture and a recipe that forgot a unit."""
    write_tiff(desk / "shot.tif", np.random.default_rng(0).random((96, 96)), {})
    (desk / "table.toml").write_text("[camera]\nfocal_length = 16\nf_number = 2\n")
    return desk


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_answered_by_a_sentence(mistake, shots, refused):
    words, named = MISTAKES[mistake]
    assert named in refused(*words.split())


def test_in_a_process_of_its_own_nothing_else_is_said(shots):
    found = subprocess.run([*PROMPT, "info", "shot.tif"], capture_output=True, text=True, timeout=120, check=False)
    assert (found.returncode, found.stdout, found.stderr.count("\n")) == (2, "", 1)


def test_the_control_a_right_command_is_not_refused(shots, run):
    assert run("estimate", "shot.tif", "--table", "lab16mm", "--noise", "0.005", "--json") == 0


def test_closed_streams_are_no_mistake(run, capfd, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", None)
        assert run("info", "lab16mm") == 0
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stderr", None)
        assert run("info", "nothing") == 2
    assert tuple(capfd.readouterr()) == ("", "")  # stdout is for results, even where messages have no place


def test_an_interruption_is_one_whatever_comes_out_of_it(run, capfd, monkeypatch):
    """Ctrl-C while compiled code is imported comes out as an ImportError."""

    def app(**_):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("initialization failed") from None

    monkeypatch.setattr(cli, "app", app)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs are deaf to it
    try:
        assert run("info", "lab16mm") == 130
        assert capfd.readouterr().err == "psflut: interrupted\n"
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
