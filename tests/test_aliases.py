"""The spectrum beyond the pixels' frequencies, against one large least-squares problem."""

import numpy as np
import pytest

from calib.aliases import Aliases, ramp, samples, spectra

WIDTH, S = 5, 3


@pytest.fixture
def problem(rng):
    """Aliases, and what their fit is given: four noise pictures at random places."""
    aliases = Aliases(WIDTH, S)
    pictures = rng.standard_normal((4, WIDTH, WIDTH))
    side = (S * WIDTH,) * 2
    power = rng.uniform(0.1, 3.0, side)
    power = power + power[::-1, ::-1]  # of a real picture
    return aliases, (
        spectra(pictures),
        rng.uniform(-0.5, 0.5, (4, 2)),
        rng.uniform(1, 2, 4),
        rng.uniform(1, 3, 4),
        power,
    )


def told(aliases, shift, flux, weight):
    """(N W^2, (s W)^2) what a spectrum is seen as, row by row in standard deviations of the noise."""
    rows = []
    for c, a, w in zip(shift, flux, weight, strict=True):
        turned = np.sqrt(w) * a * ramp(aliases.line, c)
        seen = np.zeros((WIDTH, WIDTH, S, WIDTH, S, WIDTH), complex)
        for y, x in np.ndindex(WIDTH, WIDTH):
            seen[y, x, :, y, :, x] = turned.reshape(S, WIDTH, S, WIDTH)[:, y, :, x]
        rows.append(seen.reshape(WIDTH**2, -1))
    return np.concatenate(rows)


def real(matrix):
    """A complex matrix as one of real and imaginary parts."""
    return np.block([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]])


def test_the_fit_is_the_least_squares_of_spectrum_and_round_mean_together(problem):
    aliases, (shown, shift, flux, weight, power) = problem
    fit = aliases.fit(shown, shift, flux, weight, power)
    count = power.size
    apart = 1 / np.sqrt(power.ravel())
    mean = aliases.pixel.ravel()[:, None] * (aliases.ring.ravel()[:, None] == np.unique(aliases.ring))
    seen, prior = real(told(aliases, shift, flux, weight)), np.tile(apart, 2)
    about = np.concatenate([mean, np.zeros_like(mean)])
    jacobian = np.block(
        [[seen, np.zeros((len(seen), mean.shape[1]))], [np.diag(prior), -prior[:, None] * about]]
    )  # spectrum, then profile
    right = (np.sqrt(weight)[:, None, None] * shown).ravel()
    answer = np.linalg.lstsq(jacobian, np.concatenate([right.real, right.imag, np.zeros(2 * count)]))[0]
    found = (answer[:count] + 1j * answer[count : 2 * count]).reshape(power.shape)
    assert fit.found == pytest.approx(found, abs=1e-9)
    assert fit.round == pytest.approx((mean @ answer[2 * count :]).reshape(power.shape), abs=1e-9)

    known = np.linalg.inv(jacobian.T @ jacobian)[2 * count :, 2 * count :]  # covariance of the profile
    moved = np.linalg.solve(seen.T @ seen + np.diag(prior**2), prior[:, None] ** 2 * about)
    moved = (moved[:count] + 1j * moved[count:]).T.reshape(-1, *power.shape)
    shapes = np.array([samples(each, WIDTH).ravel() for each in moved])
    assert np.sum(fit.errors**2, axis=0).ravel() == pytest.approx(np.einsum("pi,pq,qi->i", shapes, known, shapes))


def test_sums_of_aliases_are_as_far_off_as_is_stated(problem, rng):
    """Spectra drawn from the prior, and pictures of them with noise."""
    aliases, (_, shift, flux, weight, power) = problem
    seen, squares = told(aliases, shift, flux, weight), []
    for _ in range(300):
        spectrum = np.sqrt(power / power.size) * spectra(rng.standard_normal(power.shape))
        noise = spectra(rng.standard_normal((4, WIDTH, WIDTH))) / WIDTH
        shown = ((seen @ spectrum.ravel()).reshape(noise.shape) + noise) / np.sqrt(weight)[:, None, None]
        fit = aliases.fit(shown, shift, flux, weight, power)
        squares.append(np.abs(spectra(samples(fit.found - spectrum, WIDTH))) ** 2)
    of_the_mean = np.sum(np.abs(spectra(fit.errors)) ** 2, axis=0)
    assert np.mean(squares) == pytest.approx(np.mean(fit.power + of_the_mean), rel=0.05)
    assert np.mean(squares) > 1.1 * np.mean(fit.power)
