"""Whether a table's PSFs are so far from round that patches' spectra are read by direction.

Averaged over directions, the spectrum of a scene that has more in some than in others is not changed by an uneven
transfer function as the model says. On 576 captures of kodak by the lens of lab16mm with aberrations, priors learnt
from the other photographs, 128 pixels, noise 0.005 (median error up to 2.5 m, middle, beyond 3.5 m, 95 % intervals
cover, interval score; `tests/benchmarks/test_honesty.py`):

| waves | whole annuli | four sectors |
|---|---|---|
| none | 0.39, 0.66, 1.4 %, 95 %, 0.094 | 0.34, 0.50, 1.1 %, 94 %, 0.082 |
| 0.1 of astigmatism | 0.51, 0.77, 1.6 %, 92 %, 0.104 | 0.34, 0.45, 1.0 %, 93 %, 0.082 |
| 0.25 of astigmatism | 0.81, 1.4, 1.8 %, 82 %, 0.156 | 0.36, 0.55, 1.1 %, 93 %, 0.078 |
| 0.25 of coma | 0.59, 1.1, 2.2 %, 95 %, 0.257 | 0.48, 0.63, 2.7 %, 93 %, 0.115 |

Sectors tell more through any lens, as a scene's directions are alike and what blur leaves of each is known; but their
equations are of 25 coefficients in place of 10, and a patch takes 1 ms more where it took 0.5. So they are taken by
themselves where whole annuli fail, and elsewhere when asked for (``wiener:sectors=4``).
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from psflut.errors import PsflutError
from psflut.spectrum import annuli
from psflut.table import PSFTable
from psflut.texture import SECTORS

Floats = NDArray[np.float64]

UNEVEN = 0.02
"""`unevenness` (its root, nats) from which PSFs are not round. At f/2 a twentieth of a wave of astigmatism has less, a
tenth 0.026 to 0.035, a quarter 0.09, a quarter of coma 0.03."""

SIDE, PLANES, FAINT = 64, 16, 0.01
"""Pixels of the grid, planes that are looked at, and what of a scene's power must be left for a frequency to count."""


@lru_cache(maxsize=16)
def sectors(table: PSFTable) -> int:
    """Into how many sectors annuli are cut: `SECTORS` where PSFs are far from round, else 1."""
    some = np.unique(np.linspace(0, len(table.axis) - 1, PLANES).round().astype(int))
    std = None if table.psf_std is None else table.psf_std[some]
    return SECTORS if unevenness(table.psf[some], std) > UNEVEN**2 else 1


def check_sectors(sectors: int) -> None:
    """Refuse a setting of an estimator that is none."""
    if sectors not in (0, 1, SECTORS):
        raise PsflutError(
            f"annuli are whole (sectors=1), cut into {SECTORS} sectors, or as suits the table (0), got {sectors}"
        )


def unevenness(psf: Floats, std: Floats | None = None) -> float:
    """What PSFs (M, S, S) in order surely have of unevenness: a mean square, nats, less twice its standard error.

    Of half the difference of ln T between sectors at right angles, in which square pixels are alike, with T the squared
    transfer function. Squares are products of neighbouring planes, whose noise may not be the same; where standard
    errors are known, less what noise of their size does, as if it were.
    """
    halves, seen = _halves(psf)
    both = seen[:-1] & seen[1:]
    squares = np.array([np.mean(pair) for pair in _shown(halves[:-1] * halves[1:], both)])
    if len(squares) < 2:
        return 0.0
    surely = squares.mean() - 2.0 * squares.std(ddof=1) / np.sqrt(len(squares))
    if std is not None:
        noise = std * (psf > 0) * np.random.default_rng(0).standard_normal(psf.shape)
        moved = (_halves(psf + noise)[0] - halves) ** 2
        surely -= np.mean([np.mean(plane) for plane in _shown(moved, seen)])
    return float(surely)


def _halves(psf: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Half differences (M, annuli, sectors / 2), and which annuli (M, annuli) leave enough of a scene to count."""
    shape = (max(SIDE, psf.shape[-1]),) * 2
    rings = annuli(shape, SECTORS)
    power = np.full((len(psf), rings.ring.max() + 1, SECTORS), np.nan)  # NaN: no such sector, in the plane's corners
    sector = np.rint(rings.direction * SECTORS / np.pi).astype(int)
    power[:, rings.ring, sector] = rings.mean(np.abs(fft.rfft2(psf, s=shape)) ** 2)
    logs = np.log(np.maximum(power, 1e-12))
    return 0.5 * (logs[..., : SECTORS // 2] - logs[..., SECTORS // 2 :]), power.mean(axis=2) > FAINT


def _shown(values: Floats, seen: NDArray[np.bool_]) -> list[Floats]:
    """Of every plane that shows any, the values of the annuli seen."""
    return [row[mask] for row, mask in zip(values, seen, strict=True) if mask.any()]
