"""Photon transfer: the noise of a simulated camera is found again, and not where the scene did not keep still."""

import numpy as np
import pytest
from scipy import ndimage

from calib.photons import fit_line, photon_transfer
from psflut.errors import PsflutError

OFFSET = 0.02


def camera(seed, gain, read, frames=2, drift=0.0, shift=0.0, bits=None, full=0.8, side=192):
    """Frames of a blurred random scene at three distances; light and place change from frame to frame."""
    rng = np.random.default_rng(seed)
    scene = ndimage.gaussian_filter(rng.random((side, side)), 3.0, mode="wrap")
    scene = full * ((scene - scene.min()) / np.ptp(scene)) ** 2
    for blur in (0.0, 2.0, 4.0):
        still = np.maximum(ndimage.gaussian_filter(scene, blur, mode="wrap"), 0.0)
        taken = []
        for number in range(frames):
            light = (1.0 + drift * number) * ndimage.shift(still, shift * number, order=1, mode="grid-wrap")
            frame = rng.poisson(light * gain) / gain + OFFSET + rng.normal(0.0, read, still.shape)
            taken.append(frame if bits is None else digitised(frame, bits))
        yield taken


def digitised(frame, bits):
    """Rounded to the levels of an integer file; those at full scale are NaN."""
    top = 2**bits - 1
    levels = np.clip(np.rint(frame * top), 0, top)
    return np.where(levels == top, np.nan, levels / top)


# Read noise that is seen beside the shot noise: as much as that of a twentieth of full scale.
@pytest.mark.parametrize("gain", [1000.0, 3000.0, 10000.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_gain_and_read_noise_are_found_over_a_decade(gain, seed):
    read = np.sqrt(0.05 / gain)
    noise = photon_transfer(camera(seed, gain, read, frames=4), OFFSET)
    assert noise.gain == pytest.approx(gain, rel=0.05)
    assert noise.read == pytest.approx(read, rel=0.1)
    assert noise.offset == OFFSET


def test_without_a_dark_level_the_variance_is_the_same_from_the_lowest_signal_on():
    frames = list(camera(1, 1000.0, 0.01, frames=4))
    known, free = photon_transfer(frames, OFFSET), photon_transfer(frames)
    assert (free.gain, free.offset > OFFSET, free.read > known.read) == (known.gain, True, True)
    for signal in (free.offset, 0.3, 0.9):
        variances = [noise.read**2 + noise.shot_variance(signal) for noise in (known, free)]
        assert variances[0] == pytest.approx(variances[1], rel=1e-9)
    wrong = photon_transfer(frames, 0.0)  # the control: the offset matters
    assert wrong.read != pytest.approx(known.read, rel=0.05)


def test_quantisation_counts_as_read_noise():
    read, step = 0.002, 1 / 255
    noise = photon_transfer(camera(3, 20000.0, read, frames=8, bits=8), OFFSET)
    whole = np.hypot(read, step / np.sqrt(12))
    assert noise.read == pytest.approx(whole, rel=0.05)
    assert noise.read > 1.1 * read


def test_saturated_and_black_pixels_do_not_bend_the_line():
    noise = photon_transfer(camera(4, 100.0, 0.03, frames=4, bits=12, full=3.0), OFFSET)
    assert noise.gain == pytest.approx(100.0, rel=0.08)
    black = [[np.maximum(f - 0.25, 0.0) for f in taken] for taken in camera(4, 300.0, 0.03, frames=4)]
    assert np.mean(black[0][0] == 0.0) > 0.3
    noise = photon_transfer(black, OFFSET - 0.25)
    assert noise.gain == pytest.approx(300.0, rel=0.08)


def test_points_of_which_some_are_saturated_still_give_a_gain(rng):
    points = np.zeros((256, 256))
    points.flat[rng.choice(points.size, 40, replace=False)] = rng.uniform(0.2, 1.4, 40)
    light = ndimage.gaussian_filter(points, 2.0) * (8.0 * np.pi)
    frames = [rng.poisson(light * 1000.0) / 1000.0 + OFFSET + rng.normal(0.0, 0.004, light.shape) for _ in range(8)]
    noise = photon_transfer([[digitised(frame, 12) for frame in frames]], OFFSET)
    assert noise.gain == pytest.approx(1000.0, rel=0.05)
    assert noise.read == pytest.approx(0.004, rel=0.02)


def test_frames_that_are_clipped_everywhere_are_refused():
    for level in (0.0, np.nan):
        with pytest.raises(PsflutError, match="all clipped"):
            photon_transfer([[np.full((64, 64), level)] * 2])


def test_pixels_are_not_sorted_by_their_own_noise():
    """A faint scene: sorted by their own means the slope would be a fifth too flat."""
    gain, read = 1000.0, 0.02
    noise = photon_transfer(camera(5, gain, read, frames=10, full=0.15), OFFSET)
    assert noise.gain == pytest.approx(gain, rel=0.1)


def test_noise_that_does_not_grow_has_no_gain():
    flat = np.random.default_rng(6).normal(0.3, 0.01, (3, 2, 128, 128))
    slope = np.linspace(0.0, 0.5, 128)
    for scene in (flat, flat + slope):
        noise = photon_transfer(list(scene))
        assert noise.gain is None
        assert noise.read == pytest.approx(0.01, rel=0.02)


def test_without_repeats_nothing_is_said():
    assert photon_transfer([]) is None
    assert photon_transfer(frames[:1] for frames in camera(7, 1000.0, 0.01)) is None


def test_a_copy_is_no_repeat():
    with pytest.raises(PsflutError, match="taken twice"):
        photon_transfer([frames[0], frames[0]] for frames in camera(7, 1000.0, 0.01))


@pytest.mark.parametrize("change", [{"drift": 0.05}, {"shift": 1.0}])
def test_the_control_drifting_light_or_a_moving_scene_is_refused(change):
    with pytest.raises(PsflutError, match="more than noise"):
        photon_transfer(camera(8, 3000.0, 0.005, **change), OFFSET)


@pytest.mark.parametrize("change", [{"drift": 0.01}, {"shift": 0.05}])
def test_a_little_drift_is_seen_in_neighbours_and_taken_out(change):
    noise = photon_transfer(camera(8, 3000.0, 0.005, frames=2, side=320, **change), OFFSET)
    assert noise.gain == pytest.approx(3000.0, rel=0.05)


def test_correlated_noise_is_refused():
    frames = [[ndimage.gaussian_filter(f, 0.6) for f in taken] for taken in camera(9, 1000.0, 0.01)]
    with pytest.raises(PsflutError, match="compression"):
        photon_transfer(frames, OFFSET)


def test_the_line_is_straight_through_outliers_and_its_error_is_honest(rng):
    signal, count = np.linspace(0.02, 0.8, 60), np.full(60, 500.0)
    slopes = []
    for _ in range(100):
        variance = (1e-4 + signal / 2000.0) * rng.chisquare(500.0, 60) / 500.0
        variance[5] *= 4.0
        slopes.append(fit_line(signal, variance, count)[1:])
    value, error = np.array(slopes).T
    assert value.mean() * 2000.0 == pytest.approx(1.0, abs=0.03)
    assert error.mean() == pytest.approx(value.std(), rel=0.35)
