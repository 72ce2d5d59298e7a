"""A known picture gives the PSF that blurred it, with honest errors, where and how large it lies; others are refused.

Scenes are sampled four times a pixel, frames come from the pupil model at that sampling and are summed to pixels.
"""

import dataclasses
from functools import cache

import imageio.v3 as iio
import numpy as np
import pytest
from scipy import fft, ndimage, signal

from calib.targets import Shot
from calib.targets.pattern import Pattern
from psflut import read_table
from psflut.errors import PsflutError
from psflut.imagers.laplacian import Laplacian
from psflut.imagers.plain import Plain
from psflut.optics import Camera
from psflut.psfs.pupil import Pupil

LENS = Camera.of(16e-3, 6e-6, f_number=2, focus_distance=6.0)
SPLIT, SIZE, SIDE = 4, 31, 152
FINE = dataclasses.replace(LENS, pixel_pitch=LENS.pixel_pitch / SPLIT)
VIEWS = ((0.95, 1.04, 0.0), (1.3, 0.97, 0.5), (1.65, 1.02, -1.0), (2.1, 1.0, 0.3))
"""Distance (m), magnification against the reference, and turn (degrees)."""
MEASURED = VIEWS[:2]


@cache
def scene(side):
    """A binary picture with power at all scales, as soft as half a pixel: (side, side) fine samples."""
    rng = np.random.default_rng(1)
    cycles = np.hypot(fft.fftfreq(side)[:, None], fft.rfftfreq(side))
    cycles[0, 0] = np.inf
    field = fft.irfft2(fft.rfft2(rng.standard_normal((side, side))) / np.sqrt(cycles), (side, side))
    return ndimage.gaussian_filter(np.where(field > 0, 0.75, 0.08), SPLIT * 0.5)


def seen(magnification, turn, side=SIDE):
    """The scene as it lies before a frame, (side, side) pixels of fine samples."""
    turn, far = np.deg2rad(turn), SPLIT * (SIDE + 90)
    y, x = np.indices((side * SPLIT, side * SPLIT)) - (side * SPLIT - 1) / 2
    where = np.array([np.cos(turn) * y + np.sin(turn) * x, np.cos(turn) * x - np.sin(turn) * y]) / magnification
    return ndimage.map_coordinates(scene(far), where + (far - 1) / 2 + np.array([7.3, -5.1])[:, None, None], order=1)


def pixels(light):
    return light.reshape(len(light) // SPLIT, SPLIT, len(light) // SPLIT, SPLIT).mean(axis=(1, 3))


def camera(light, seed, imager=None, gain=20_000.0, read=0.002, bits=12):
    rng = np.random.default_rng(seed)
    frame = rng.poisson(light * gain) / gain
    frame = (frame if imager is None else imager.response(frame)) + read * rng.standard_normal(light.shape)
    levels = 2**bits - 1
    return frame if imager else np.round(frame.clip(0, 1) * levels) / levels


@cache
def blurred(distance, magnification, turn):
    psf = Pupil()(FINE, distance, SIZE * SPLIT + 1)
    return pixels(signal.oaconvolve(seen(magnification, turn, SIDE + 36), psf, mode="same"))[18:-18, 18:-18]


def shot(view, seed=0, change=lambda light: light, **settings):
    return Shot(camera(change(blurred(*view)), seed, **settings), view[0], f"shot {seed}")


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """A file: the mean of some sharp frames, wider than those that are to be measured."""
    path = tmp_path_factory.mktemp("reference") / "sharp.png"
    sharp = pixels(seen(1.0, 0.0, SIDE + 40))
    frame = np.mean([camera(sharp, 100 + seed) for seed in range(4)], axis=0)
    iio.imwrite(path, np.round(frame * 65535).astype(np.uint16))
    return str(path)


def truth(distance):
    return Pupil()(LENS, distance, SIZE)


@pytest.fixture(scope="module")
def measured(reference):
    return [Pattern(reference).measure([shot(view, seed)], SIZE, Plain()) for seed, view in enumerate(MEASURED)]


def test_the_psf_comes_back_though_the_picture_is_shifted_turned_and_of_another_size(measured):
    errors = [np.abs(each.psf - truth(view[0])).sum() for each, view in zip(measured, MEASURED, strict=True)]
    assert np.mean(errors) < 0.08
    assert all(each.psf.sum() == pytest.approx(1.0) for each in measured)


def test_the_control_the_error_tells_neighbouring_distances_apart(measured):
    assert np.abs(measured[1].psf - truth(1.4)).sum() > 0.1


def test_standard_errors_are_honest(measured):
    """Within the factor that a calibration promises."""
    error = sum(np.sum((each.psf - truth(view[0])) ** 2) for each, view in zip(measured, MEASURED, strict=True))
    assert 1 / 1.3 < np.sqrt(error / sum(np.sum(each.std**2) for each in measured)) < 1.3


def test_light_that_falls_off_and_a_background_do_no_harm(reference):
    """Nor another exposure."""
    across = np.linspace(0.7, 1.1, SIDE)
    frame = shot(VIEWS[1], 1, lambda light: 0.06 + 0.8 * light * across * across[:, None])
    found = Pattern(reference).measure([frame], SIZE, Plain())
    assert np.abs(found.psf - truth(VIEWS[1][0])).sum() < 0.08


def test_a_laplacian_imager_is_taken_out(reference):
    view = VIEWS[2]
    frame = shot(view, 1, imager=Laplacian(), gain=2e6, read=0.0005)
    found = Pattern(reference).measure([frame], SIZE, Laplacian())
    assert np.abs(found.psf - truth(view[0])).sum() < 0.08


def test_a_lens_with_coma_is_seen_to_be_lopsided(reference):
    """Its waves are those of order 1; a symmetric fit cannot have them."""
    lens = Pupil(zernikes=((3, 1, 0.25),))
    scene = seen(1.0, 0.0, SIDE + 36)
    light = pixels(signal.oaconvolve(scene, lens(FINE, 1.5, SIZE * SPLIT + 1), mode="same"))[18:-18, 18:-18]
    frame, known = Shot(camera(light, 1), 1.5, "coma"), lens(LENS, 1.5, SIZE)
    errors = [np.abs(Pattern(reference, order=n).measure([frame], SIZE, Plain()).psf - known).sum() for n in (0, 2)]
    assert errors[1] < 0.6 * errors[0]


def with_white(frame, share):
    image = frame.image.copy()
    image[: int(share * len(image))] = np.nan
    return dataclasses.replace(frame, image=image)


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (lambda: Shot(np.full((SIDE, SIDE), 0.4), 1.0, "flat"), "one grey"),
        (lambda: Shot(camera(pixels(scene(4 * SIDE)), 1), 1.0, "another"), "does not show"),
        (lambda: with_white(shot(VIEWS[1]), 0.3), "saturated in"),
        (lambda: shot(VIEWS[1], change=lambda light: 0.4 + 0.02 * light, gain=300), "does not|too little"),
    ],
)
def test_what_does_not_show_the_reference_is_refused(reference, frame, reason):
    with pytest.raises(PsflutError, match=reason):
        Pattern(reference).measure([frame()], SIZE, Plain())


def test_too_small_an_overlap_is_refused(reference):
    with pytest.raises(PsflutError, match="less than 260 pixels"):
        Pattern(reference, least_side=260).measure([shot(VIEWS[1])], SIZE, Plain())


def test_one_bad_shot_is_named_and_the_others_serve(reference):
    found = Pattern(reference).measure([shot(VIEWS[1], 1), with_white(shot(VIEWS[1], 2), 0.3)], SIZE, Plain())
    assert found.used == 1
    assert found.rejected[0].startswith("shot 2: is saturated in")


def test_a_reference_there_must_be():
    with pytest.raises(PsflutError, match="needs a reference"):
        Pattern().measure([shot(VIEWS[1])], SIZE, Plain())
    with pytest.raises(PsflutError, match="no image file"):
        Pattern("nowhere.png").measure([shot(VIEWS[1])], SIZE, Plain())


# --- the command line


@pytest.fixture(scope="module")
def captures(tmp_path_factory):
    folder = tmp_path_factory.mktemp("captures")
    rows = ["file,distance_m"]
    for number, view in enumerate(VIEWS[1:]):
        iio.imwrite(folder / f"{number}.png", np.round(65535 * shot(view, number).image).astype(np.uint16))
        rows.append(f"{number}.png,{view[0]}")
    (folder / "captures.csv").write_text("\n".join(rows))
    return folder / "captures.csv"


def test_frames_and_a_reference_become_a_table(captures, reference, run, tmp_path):
    output = tmp_path / "table.zarr.zip"
    words = ["calibrate", captures, "--target", "pattern", "--reference", reference, "--pixel-pitch", "6 um"]
    assert run(*words, "--size", SIZE, "-o", output) == 0
    table = read_table(output)
    errors = [np.abs(plane - truth(z)).sum() for z, plane in zip(table.axis, table.psf, strict=True)]
    assert np.mean(errors) < 0.08
    assert table.provenance["target"].startswith("pattern:reference=")


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--target", "pattern"], "needs a reference; pass --reference"),
        (["--target", "pattern", "--reference", "nowhere.png"], "no image file at nowhere.png"),
        (["--target", "point", "--reference", "nowhere.png"], "point takes no --reference"),
    ],
)
def test_a_reference_goes_with_a_pattern_and_with_nothing_else(captures, words, reason, run, capsys, tmp_path):
    code = run("calibrate", captures, *words, "--pixel-pitch", "6 um", "-o", tmp_path / "t.zarr.zip")
    assert code == 2
    assert reason in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
