"""Bright points: one PSF, pixel integration included, fitted to all of them at their sub-pixel places."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, special

from calib.stamps import Stamp, around, cut, find
from calib.superresolution import Fit, superresolve
from calib.targets import Measurement, Shot, Target
from calib.unfilter import unfilter
from psflut.errors import PsflutError
from psflut.imagers import Imager

Floats = NDArray[np.float64]

UNLIKE, UNLIKE_MADS = 2.0, 5.0
"""A point is unlike the rest if its residual power is so many times, and robust deviations above, the median."""

OVERSAMPLINGS = (1, 3, 5, 7)
"""Beyond 7 the fit takes gigabytes and says no more."""

COARSE_ROUNDS = 5
"""Of a first fit by Fourier shifts, which settles the places."""

LEAST_FINE = 4
"""Points from which aliases can be told apart; fewer are averaged by Fourier shifts."""

DRAWS = 200
"""Of the noise, from which standard errors come: they are good to 5 %."""


@dataclass(frozen=True)
class Point(Target):
    """Bright points, one or many a frame, found or given by `Shot.centre` (then the only one of its frame).

    A point i shows g_i(x) = a_i p(x - c_i) + b_i with p = L * h, pixel integration included. A PSF of a pixel
    or two is under-sampled, and averaging by Fourier shifts or splines mixes its aliases up. Here p is fitted
    beyond the pixels' Nyquist frequency to all points at once, and places and fluxes with it, as
    `calib.superresolution` says; what the points do not tell is thought to be near round (`calib.aliases`). Fewer
    than four points are averaged by Fourier shifts, and their standard errors (1.3 to 4 times too small) know nothing
    of aliases.

    Measured on 32 points through an f/2 lens, summed |error|, over the whole window:

    | blur radius, pixels | 9.2 | 4.5 | 2.1 | 0.9 | 0.4 |
    |---|---|---|---|---|---|
    | about a round mean, 5 times as finely: taken | 0.009 | 0.013 | 0.026 | 0.079 | 0.17 |
    | about zero, 3 times as finely | 0.013 | 0.021 | 0.057 | 0.11 | 0.22 |

    Fourier shifts gave 0.034, 0.063 and 0.16 at 9.5, 4.8 and 1.9 pixels (18 points).

    The background b_i is the clipped mean around the PSF's window. L and a pinhole of finite size are taken out
    by `calib.unfilter`, which also says where the mean comes from that L hides.

    Parameters
    ----------
    pinhole : float
        Diameter of each point's sharp image, pixels.
    least_snr : float
        Root of energy over noise sigma below which a point is too faint.
    separation : float
        Least distance between two points, in units of the PSF's size.
    oversampling : int
        Odd; how far beyond the pixels' sampling p is fitted. 1 is averaging by Fourier shift, without a round mean, and
        better for few points of unlike shapes: of microscope beads it put 2 % on the wrong side of focus, 3 did 15 %.
    rounds : int
        Of fitting p and the places in turn.
    """

    pinhole: float = 0.0
    least_snr: float = 20.0
    separation: float = 1.0
    oversampling: int = 5
    rounds: int = 20

    def __post_init__(self) -> None:
        if not (self.pinhole >= 0 and self.least_snr > 0 and self.separation > 0):
            raise PsflutError(
                "a pinhole has 0 pixels or more, a signal-to-noise ratio and a separation are above 0, got "
                f"{self.pinhole:g}, {self.least_snr:g} and {self.separation:g}"
            )
        if self.oversampling not in OVERSAMPLINGS or self.rounds < 1:
            raise PsflutError(
                f"oversampling is one of {', '.join(map(str, OVERSAMPLINGS))} and rounds are one or more, got "
                f"{self.oversampling} and {self.rounds}"
            )

    def measure(self, shots: Sequence[Shot], size: int, imager: Imager) -> Measurement:
        """See `Target`. Standard errors are those of independent noise, as large as the residuals say.

        Through a lens without aberrations errors of 18 points were 0.75 to 1.0 of them where blur is wider than a
        pixel in radius, and half of them nearer to focus: a round PSF is better known than the fit dares to say.
        With a quarter wave of astigmatism they were 1.0 to 1.7 of them in the bright part, from 2 pixels to focus.
        """
        stamps, rejected = self._collect(shots, size, imager.signed)
        while stamps:
            images, shift, dark = (np.array(part) for part in list(zip(*stamps, strict=True))[:3])
            coarse, noise = _coarse(images, shift, dark)  # the finer fit would bend to an outlier
            bad = _unlike(coarse, noise)
            if not bad.any():
                finer = self.oversampling if len(stamps) >= LEAST_FINE else 1
                fit = superresolve(images, coarse.shift, noise, finer, self.rounds)
                return Measurement(*self._finish(fit, size, imager), len(stamps), tuple(rejected))
            rejected += [f"{stamp.name}: shape unlike the rest" for stamp, out in zip(stamps, bad, strict=True) if out]
            stamps = [stamp for stamp, out in zip(stamps, bad, strict=True) if not out]
        reason = f"every point was rejected, as {rejected[0]}" if rejected else f"no point was found in {shots[0].name}"
        raise PsflutError(f"{reason}; take points that stand out, below full scale, well apart and from the border")

    def _collect(self, shots: Sequence[Shot], size: int, signed: bool) -> tuple[list[Stamp], list[str]]:
        """The points fit for use, and why others are not."""
        stamps: list[Stamp] = []
        rejected: list[str] = []
        for shot in shots:
            places = find(shot.image, size, signed) if shot.centre is None else np.array([shot.centre], dtype=float)
            for place in places:
                name = f"{shot.name} at y {place[0]:.0f}, x {place[1]:.0f}"
                near = np.sum(np.hypot(*(places - place).T) < self.separation * size) > 1
                stamp = "too near to another point" if near else cut(shot.image, place, size, name, self.least_snr)
                if isinstance(stamp, str):
                    rejected.append(f"{name}: {stamp}")
                else:
                    stamps.append(stamp)
        return stamps, rejected

    def _finish(self, fit: Fit, size: int, imager: Imager) -> tuple[Floats, Floats]:
        """PSF and standard error, of sum 1; imager and pinhole taken out where there are any."""
        if self.pinhole > 0 or imager.kernel().size > 1:
            return unfilter(fit.psf, fit.variance, _shown(imager, self.pinhole, len(fit.psf)), size)
        outside, crop = around(len(fit.psf), size), slice((len(fit.psf) - size) // 2, (len(fit.psf) + size) // 2)

        def psf(shown: Floats) -> Floats:
            inner = (shown - shown[outside].mean())[crop, crop]
            return np.asarray(inner / inner.sum())

        rng = np.random.default_rng(0)
        return psf(fit.psf), np.std([psf(drawn) for drawn in fit.draws(rng, DRAWS)], axis=0)


def _coarse(images: Floats, shift: Floats, dark: Floats) -> tuple[Fit, Floats]:
    """A fit by Fourier shifts, and the relative variance (N,) of every window's pixels about the common shape.

    Points differ in shape by some share of their light, so that the brightest do not tell most: to the variance of the
    dark comes the energy times what the median point leaves of its own. In the first fit all points count alike. The
    mean stays that of the dark: how much the residuals exceed it is for the fit to say.
    """
    energy = np.maximum(np.sum(images**2, axis=(1, 2)), dark)
    alike = superresolve(images, shift, energy * np.median(dark / energy), 1, COARSE_ROUNDS)
    excess = np.maximum(np.mean(alike.residual**2, axis=(1, 2)) - dark, 0.0)
    noise = dark + energy * np.median(excess / energy)
    noise *= dark.mean() / noise.mean()
    return superresolve(images, alike.shift, noise, 1, COARSE_ROUNDS), noise


def _unlike(fit: Fit, noise: Floats) -> NDArray[np.bool_]:
    """Which points leave far more than the others do."""
    left = np.log(np.mean(fit.residual**2, axis=(1, 2)) / noise)
    above = left - np.median(left)
    return np.asarray(above > max(np.log(UNLIKE), UNLIKE_MADS * 1.4826 * float(np.median(np.abs(above)))))


def _shown(imager: Imager, pinhole: float, width: int) -> Floats:
    """What imager and pinhole make of a point (W, W), centred."""
    y, x = fft.fftfreq(width)[:, None], fft.rfftfreq(width)
    radius = np.maximum(np.pi * pinhole * np.hypot(y, x), 1e-9)
    transfer = imager.transfer((width, width)) * 2 * special.j1(radius) / radius
    return np.asarray(fft.fftshift(fft.irfft2(transfer, (width, width))))
