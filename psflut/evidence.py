"""The evidence for every distance at once: what the power spectrum of one patch says of its blur.

A patch is g = h(z) * L * f + n. In annulus k its power P_k has the mean

    V_k(z, theta) = S_k(theta) |L|^2_k T_k(z) + N_k

with S the scene's spectrum (`psflut.texture`), T the squared OTF as the taper's leakage leaves it (`psflut.leakage`),
N the noise. Given V, P_k is gamma distributed with shape a_k (the annulus' effective bins):

    ln p(P | z, theta) = - sum_k a_k (ln V_k + P_k / V_k)  + what depends on P and a alone

and theta has the texture prior p(theta). `psflut.laplace` integrates the scene out, for all distances together;
emcee samples the same density, `log_joint`.

What else a patch might tell was tried on 576 captures of kodak (lab16mm, 128 pixels, priors learnt from the other
photographs; median error near, in the middle, far):

* its pixels over their local amplitude, smoothed over 16 or 24 pixels (a scale mixture of normals): 0.33 to 0.42, 0.75
  to 0.89, 1.5 to 1.7 % instead of 0.32, 0.74, 1.3 %;
* its likeness to edges (kurtosis, skewness and unevenness of what is fine in it, and its anisotropy): correlations
  with the error, in its standard deviations, stay within 0.17, and a regression on all, learnt from the other
  photographs, makes errors no smaller;
* annuli cut in two, three or four sectors, each with a spectrum of its own: the same within chance for a PSF without
  aberrations.

What does tell more is sectors whose spectra are tied together as those of photographs are (`psflut.texture`): a scene's
directions are alike, and what blur leaves of each is known. Averaged over directions, moreover, the spectrum of a scene
that has more in some than in others is not changed by an uneven transfer function as the model says. Four sectors are
the default; through the lens of lab16mm with aberrations (128 pixels, as above; median error up to 2.5 m, middle,
beyond 3.5 m, 95 % intervals cover, interval score; `tests/benchmarks/test_honesty.py`):

=======================  =====================================  =====================================
waves                    whole annuli                           four sectors
=======================  =====================================  =====================================
none                     0.39, 0.66, 1.4 %, 95 %, 0.094         0.33, 0.47, 1.4 %, 94 %, 0.079
0.1 of astigmatism       0.51, 0.77, 1.6 %, 92 %, 0.104         0.32, 0.46, 1.0 %, 94 %, 0.078
0.25 of astigmatism      0.81, 1.4, 1.8 %, 82 %, 0.156          0.37, 0.52, 1.1 %, 93 %, 0.083
0.25 of coma             0.59, 1.1, 2.2 %, 95 %, 0.257          0.46, 0.61, 2.7 %, 92 %, 0.142
=======================  =====================================  =====================================
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from psflut.imagers import Imager
from psflut.leakage import passed
from psflut.noise import Noise
from psflut.spectrum import Annuli, annuli
from psflut.table import PSFTable
from psflut.texture import TexturePrior

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Bank:
    """What the evidence needs of a table for patches of one shape: K annuli, M distances, J coefficients.

    Parameters
    ----------
    rings : Annuli
    even : (M,) array
        Candidates in the coordinate in which the prior is flat (vergence in 1/m, or stage in m).
    attenuation : (M, K) array
        |L|^2 T: what imager and optics leave of the scene's power.
    imager, white : (K,) arrays
        |L|^2, which also colours the photon noise, and the power of white noise of variance 1, as annuli show them.
    shape : (K,) or (M, K) array
        Gamma shapes a.
    prior : TexturePrior
    """

    rings: Annuli
    even: Floats
    attenuation: Floats
    imager: Floats
    white: Floats
    shape: Floats
    prior: TexturePrior

    def under(self, prior: TexturePrior) -> "Bank":
        """The same with another prior."""
        return replace(self, shape=prior.shape(self.rings.effective, self.rings.place), prior=prior)

    @cached_property
    def basis(self) -> Floats:
        """(K, J) what the coefficients multiply in ln S."""
        return self.prior.basis(self.rings.frequency, self.rings.direction)

    def at(self, even: ArrayLike) -> Floats:
        """Attenuation (..., K) between the candidates, by a cubic spline."""
        return np.asarray(np.maximum(self._spline(np.clip(even, self.even.min(), self.even.max())), 0.0))

    def slope(self, even: ArrayLike) -> Floats:
        """Derivative (..., K) of the attenuation by the even coordinate."""
        return np.asarray(self._spline(np.clip(even, self.even.min(), self.even.max()), 1))

    def counted(self, share: float) -> "Bank":
        """The same with shapes that count for that share."""
        other = replace(self, shape=share * self.shape)
        vars(other).update(_spline=self._spline, basis=self.basis)  # of what has not changed
        return other

    @cached_property
    def _spline(self) -> CubicSpline:
        order = np.argsort(self.even)
        return CubicSpline(self.even[order], self.attenuation[order])


def bank(
    table: PSFTable, shape: tuple[int, int], imager: Imager, prior: TexturePrior, count: int, sectors: int = 1
) -> Bank:
    """The bank of `count` candidates over the table's span for patches of that shape, annuli whole or in sectors."""
    rings, positions = annuli(shape, sectors), table.candidates(count)
    prior = prior.over(sectors)
    return Bank(
        rings=rings,
        even=table.even(positions),
        attenuation=np.maximum(passed(table.at(positions), rings, imager), 0.0),
        imager=rings.leaked(imager.transfer(rings.doubled) ** 2),
        white=rings.white,
        shape=prior.shape(rings.effective, rings.place),
        prior=prior,
    )


def noise_power(bank: Bank, noise: Noise, level: ArrayLike) -> Floats:
    """N_k: read noise, and photon noise of a patch of that mean level, coloured by the imager. Of several levels (...),
    (..., K)."""
    return noise.power(bank.imager, level, bank.white)


def scene_power(attenuation: Floats, theta: Floats, bank: Bank) -> Floats:
    """S_k |L|^2_k T_k, what the capture holds of the scene: attenuation (..., K), theta (..., J) -> (..., K)."""
    return np.asarray(attenuation * np.exp(theta @ bank.basis.T))


def log_likelihood(power: Floats, mean: Floats, shape: Floats) -> Floats:
    """ln p(P | V) of gamma distributed powers over annuli, (..., K) -> (...), without what V does not enter."""
    return np.asarray(-np.sum(shape * (np.log(mean) + power / mean), axis=-1))


def misfit(power: Floats, mean: Floats, bank: Bank) -> Floats:
    """Deviance an annulus of powers from their mean, (..., K) -> (...); 0.4 to 0.8 on most photographs.

    At the likeliest distance, above about 2.5 (3 % of patches of 64 and 128 pixels), the spectrum is one that no
    distance of the table explains well: an object beyond the table, another camera, a periodic pattern. Sectors are
    put together first: each scatters so much more that rings which no blur of the table has show less in them. (Half
    of 78 objects at 0.65 to 0.78 m, before the table's first 0.8 m, have 1.43 and more, 1.9 times the usual; sector by
    sector 0.67, 1.15 times.)
    """
    rings, shape = bank.rings, np.bincount(bank.rings.ring, bank.shape)
    ratio = rings.whole(power) / rings.whole(mean)
    return np.asarray(2 * np.mean(shape * (ratio - 1 - np.log(ratio)), axis=-1))


def discount(misfit: Floats, bank: Bank) -> Floats:
    """Share at which the shapes of a patch of that misfit count: less where annuli scatter more than is usual.

    A scene that the model does not suit (a fence, a few edges) shows it by its misfit at the likeliest distance; the
    shapes are divided by how many times more than the usual (`TexturePrior.misfit`) it is. Compared on 576 captures
    of kodak at 0.9 to 4.5 m, each with a prior learnt from the other photographs, before gross errors were counted:
    95 % intervals covered 91 % without it and 94 % with it (of far patches 86 and 92 %), mean interval score 0.20 and
    0.17. Dividing the log evidence instead gives the same, but is the density of no joint model that a sampler could
    draw from.
    """
    return np.minimum(1.0, bank.prior.usual(bank.rings.count) / misfit)


def log_prior(theta: Floats, prior: TexturePrior) -> Floats:
    """ln p(theta) without its constant: (..., J) -> (...)."""
    offset = theta - prior.mean
    return np.asarray(-0.5 * np.sum((offset @ prior.precision) * offset, axis=-1))


def log_joint(power: Floats, attenuation: Floats, noise: Floats, theta: Floats, bank: Bank) -> Floats:
    """ln p(P | z, theta) + ln p(theta): attenuation (..., K) at z, noise power (..., K), theta (..., J)."""
    mean = scene_power(attenuation, theta, bank) + noise
    return log_likelihood(power, mean, bank.shape) + log_prior(theta, bank.prior)
