"""The bound, against fields that are drawn and blurred, and against what any bound must do."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import fft

from psflut import ensemble, information, limits, plots, texture
from psflut.capture import psf_of
from psflut.covariance import covariance
from psflut.ensemble import Sensor
from psflut.fourier import transfer
from psflut.imagers.laplacian import Laplacian
from psflut.imagers.plain import Plain
from psflut.noise import Noise
from psflut.spectrum import annular_power, annuli
from psflut.table import PSFTable

NOISE, SHAPE, LARGE = Noise(0.005), (64, 64), (128, 128)


@pytest.fixture(scope="module")
def found(lab16mm):
    return {scene: limits.bound(lab16mm, SHAPE, NOISE, Plain(), scene=scene) for scene in ("unknown", "known", "point")}


@pytest.mark.parametrize(("shape", "sectors"), [((64, 64), 1), ((48, 65), 1), ((48, 65), texture.SECTORS)])
def test_white_noise_has_the_covariance_of_its_annuli(shape, sectors, rng):
    rings = annuli(shape, sectors)
    powers = np.array([rings.power(rng.standard_normal(shape)) / rings.white for _ in range(4000)])
    level = np.ones((2 * shape[0], shape[1] + 1))
    expected, seen = covariance(rings, level), np.cov(powers.T)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.max(np.abs(seen - expected) / scale) < (5 if sectors == 1 else 6) / np.sqrt(4000)
    assert np.median(np.diag(seen, 1) / np.diag(scale, 1)) > 3 / np.sqrt(4000)  # the control: ties show


def field(spectrum, psf, rng):
    """A patch of a Gaussian field with that spectrum (rfft grid of `LARGE`), blurred and noisy."""
    waves = fft.rfft2(rng.standard_normal(LARGE)) * np.sqrt(spectrum) * transfer(psf, LARGE)
    return fft.irfft2(waves, s=LARGE)[:64, :64] + NOISE.read * rng.standard_normal(SHAPE)


def test_a_linear_estimate_on_drawn_fields_errs_by_the_bound(lab16mm):
    """Generalised least squares with the spectrum's shape and amplitude in doubt, linear about the truth.

    Fields come from the pupil model; how the mean powers change with distance is taken from fields as well.
    """
    distance, step = 1.37, 0.01
    prior = texture.learnt()
    prior = replace(prior, mean=prior.mean[:2], covariance=np.diag([1e4, 1e4]), roughness=0.0)
    frequency = np.hypot(fft.fftfreq(LARGE[0])[:, None], fft.rfftfreq(LARGE[1]))
    frequency[0, 0] = frequency[0, 1]
    spectrum = np.exp(texture.basis(frequency.ravel(), 2) @ prior.mean).reshape(frequency.shape)
    draws = 400

    def powers(psf, times=1.0):
        fresh = np.random.default_rng(7)  # the same noise for every derivative
        return np.array([annular_power(field(spectrum * times, psf, fresh)) for _ in range(draws)])

    near, far = (powers(psf_of(lab16mm, distance + sign * step)).mean(axis=0) for sign in (-1, 1))
    tilt = np.log(frequency / 0.1)
    bend = [powers(psf_of(lab16mm, distance), np.exp(0.1 * each)).mean(axis=0) for each in (1.0, tilt)]
    sample = powers(psf_of(lab16mm, distance))
    mean = sample.mean(axis=0)
    columns = np.stack([(far - near) / (2 * step), *((each - mean) / 0.1 for each in bend)], axis=1) / mean[:, None]
    shown = spectrum * np.abs(transfer(psf_of(lab16mm, distance), LARGE)) ** 2 + NOISE.read**2
    weighted = np.linalg.solve(covariance(annuli(SHAPE), shown), columns)
    answers = (sample / mean - 1) @ weighted @ np.linalg.inv(columns.T @ weighted)
    scenes = ensemble.textures(lab16mm, SHAPE, Plain(), prior, 1.0, 201)
    only = replace(scenes, spectra=np.exp(scenes.bank.basis @ prior.mean)[None])
    told = information.of_texture(only, Sensor(Plain(), NOISE))[:, 0]
    positions = lab16mm.candidates(201)
    expected = np.interp(distance, positions, positions**2 / np.sqrt(told))
    assert np.std(answers[:, 0]) == pytest.approx(expected, rel=0.1)  # 3.5 % is chance


def test_the_information_of_a_known_scene_is_that_of_its_difference(lab16mm):
    """A scene drawn and blurred at two distances: |difference|^2 over the noise, by no formula."""
    rng, distance, step = np.random.default_rng(0), 1.37, 0.002
    prior = replace(texture.learnt(), covariance=1e-12 * np.eye(10))
    frequency = np.hypot(fft.fftfreq(64)[:, None], fft.rfftfreq(64))
    spectrum = np.exp(texture.basis(np.maximum(frequency, 2.5 / 64).ravel(), 10) @ prior.mean).reshape(frequency.shape)
    spectrum[annuli(SHAPE).index == len(annuli(SHAPE).frequency)] = 0.0
    near, far = (transfer(psf_of(lab16mm, distance + sign * step), SHAPE) for sign in (-1, 1))
    waves = [fft.rfft2(rng.standard_normal(SHAPE)) * np.sqrt(spectrum) for _ in range(200)]
    change = np.array([fft.irfft2(wave * (far - near), s=SHAPE) / (2 * step) for wave in waves])
    expected = NOISE.read / np.sqrt(np.mean(np.sum(change**2, axis=(1, 2))))
    found = limits.bound(lab16mm, SHAPE, NOISE, Plain(), scene="known", prior=prior)
    assert np.interp(distance, found.axis, found.crb) == pytest.approx(expected, rel=0.03)


def test_a_point_is_read_within_the_bound_by_a_fit_that_knows_the_table(lab16mm):
    """Linear least squares on drawn noise, with the model's own PSFs moved and dimmed by finite steps."""
    rng, distance = np.random.default_rng(5), 1.37
    found = limits.bound(lab16mm, SHAPE, NOISE, Plain(), scene="point", contrast=0.5)
    light = 0.5 / lab16mm.at(lab16mm.candidates(101)).max()

    def shown(z, move=(0.0, 0.0)):
        phase = np.exp(-2j * np.pi * (move[0] * fft.fftfreq(64)[:, None] + move[1] * fft.rfftfreq(64)))
        return light * fft.irfft2(transfer(psf_of(lab16mm, z), SHAPE) * phase, s=SHAPE).ravel()

    here = shown(distance)
    columns = np.stack(
        [
            (shown(distance + 0.005) - shown(distance - 0.005)) / 0.01,
            here,
            np.ones(64 * 64),
            (shown(distance, (0.01, 0)) - here) / 0.01,
            (shown(distance, (0, 0.01)) - here) / 0.01,
        ],
        axis=1,
    )
    answers = np.linalg.pinv(columns)[0] @ (NOISE.read * rng.standard_normal((64 * 64, 2000)))
    assert np.interp(distance, found.axis, found.crb) == pytest.approx(np.std(answers), rel=0.06)


def test_who_knows_more_is_nearer(found):
    assert np.all(found["known"].crb < found["unknown"].crb)


def test_photons_widen_a_points_bound(lab16mm, found):
    counted = limits.bound(lab16mm, SHAPE, Noise(0.005, gain=1000), Plain(), scene="point")
    assert np.all(counted.crb > found["point"].crb)


def test_a_larger_patch_says_more_in_the_ratio_of_its_bins(lab16mm, monkeypatch):
    """Twice the side: about four times the bins, so half the bound, or less near zeros that it resolves."""
    monkeypatch.setattr(limits, "COUNT", 25)
    small, large = (limits.bound(lab16mm, (n, n), NOISE, Plain()) for n in (128, 256))
    ratio = small.crb / large.crb
    assert np.all(ratio > 1.2)
    assert 1.8 < np.median(ratio) < 2.4
    known = [limits.bound(lab16mm, (n, n), NOISE, Plain(), scene="known").crb for n in (96, 192)]
    assert np.median(known[0] / known[1]) == pytest.approx(2.0, rel=0.05)


def test_noise_and_contrast_only_matter_by_their_ratio(lab16mm, found):
    usual = found["unknown"]
    both = limits.bound(lab16mm, SHAPE, Noise(0.01), Plain(), contrast=2 * usual.contrast)
    np.testing.assert_allclose(both.crb, usual.crb, rtol=1e-6)
    assert np.all(limits.bound(lab16mm, SHAPE, Noise(0.01), Plain()).crb > usual.crb)
    known = limits.bound(lab16mm, SHAPE, Noise(0.01), Plain(), scene="known")
    np.testing.assert_allclose(known.crb, 2 * found["known"].crb, rtol=1e-6)


def test_relative_noise_does_not_ask_for_contrast(thesis):
    one, two = (
        limits.bound(thesis, (64, 64), Noise(0.03), Laplacian(), contrast=c, relative=True).crb for c in (0.04, 0.2)
    )
    np.testing.assert_allclose(one, two, rtol=1e-6)


def test_photographs_scatter_more_than_gaussian_fields(lab16mm, found):
    assert np.all(limits.bound(lab16mm, SHAPE, NOISE, Plain(), prior=texture.learnt()).crb > found["unknown"].crb)


def test_a_table_that_does_not_change_is_blind_and_its_span_is_all_that_is_known(lab16mm):
    same = PSFTable(lab16mm.axis, np.repeat(lab16mm.psf[:1], 64, axis=0), lab16mm.pixel_pitch)
    for scene in ("unknown", "known", "point"):
        found = limits.bound(same, SHAPE, NOISE, Plain(), scene=scene)
        assert not found.good
        assert found.blind == [same.span]
        flat = np.ptp(1 / np.array(same.span)) / np.sqrt(12) * found.axis**2
        np.testing.assert_allclose(found.within, flat, rtol=1e-3)


def test_a_stage_axis_is_counted_in_metres_of_stage(lab16mm, found):
    """The same PSFs over an axis that is the vergence itself: bounds differ by the chain rule alone."""
    stage = PSFTable(1 / lab16mm.axis[::-1], lab16mm.psf[::-1], lab16mm.pixel_pitch, kind="stage")
    for scene, usual in found.items():
        moved = limits.bound(stage, SHAPE, NOISE, Plain(), scene=scene)
        np.testing.assert_allclose(moved.crb[::-1], usual.crb / usual.axis**2, rtol=1e-5)


def test_the_figure_shows_bounds_and_shades_what_is_blind(found):
    figure = plots.limits({"unknown": found["unknown"]})
    axis = figure.axes[0]
    assert "%" in axis.get_ylabel()
    assert "(m)" in axis.get_xlabel()
    np.testing.assert_allclose(axis.lines[0].get_ydata(), 100 * found["unknown"].relative)
    assert len(axis.patches) == len(found["unknown"].blind) > 0
