"""Learn the numbers of `psflut.texture` from a folder of sharp photographs.

    python -m calib.textures FOLDER -o psflut/texture.json

Photographs carry their own blur, so each is shrunk two-fold first (2 x 2 means). The model of a sharp patch,
y = ln P = B theta + e with theta ~ normal(mean, covariance) and var e_k = psi'(n_k) + roughness^2, is fitted by
expectation maximisation.
"""

import argparse
import hashlib
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, polygamma

from calib.gross import ROUNDS, learn_gross
from psflut.errors import PsflutError
from psflut.files import staged
from psflut.images import read_image
from psflut.spectrum import annuli
from psflut.store import read_table
from psflut.texture import EVERY, SECTORS, TexturePrior, around, turning

Floats = NDArray[np.float64]

SIZES = (64, 128, 256)
"""Sides of the patches learnt from, pixels."""

ROUNDS_OF_EM = 50
"""Of expectation maximisation. More fit patches of 64 pixels by ever wilder spectra at frequencies below any of
theirs: after 200 rounds the mean there is e^3 times what patches of 256 pixels show, after 1000 e^10 times."""

FREE_CONTRAST = 3.0
"""Standard deviation of the prior on theta_0, in nats: a factor of 20 in power either way."""


TURNS = 3
"""Terms of what differs with direction. With 10, 7, 5 and 3 errors are alike on 288 captures through an astigmatic lens
(128 pixels: 0.33, 0.32, 0.31, 0.32 % up to 2.5 m, 0.45, 0.47, 0.46, 0.53 in the middle); roughness takes the rest."""


class Spectra(NamedTuple):
    """ln power (N, K) of N patches of one size, less its sampling bias; the basis (K, J) at their frequencies, the
    sampling variance (K,) of ln power, and from which photograph (N,) each patch is."""

    log_power: Floats
    basis: Floats
    variance: Floats
    photograph: NDArray[np.intp]

    def without(self, photograph: int) -> "Spectra":
        """Those of all other photographs."""
        kept = self.photograph != photograph
        return self._replace(log_power=self.log_power[kept], photograph=self.photograph[kept])


def shrink(image: Floats) -> Floats:
    """Means of 2 x 2 pixels: a photograph's own blur halves."""
    height, width = (n - n % 2 for n in image.shape)
    return np.asarray(image[:height, :width].reshape(height // 2, 2, width // 2, 2).mean(axis=(1, 3)))


def spectra(images: Sequence[Floats], size: int, terms: int, sectors: int = 1) -> Spectra:
    """Half-overlapping square patches of that side (pixels) of sharp images; flat ones are left out."""
    rings = annuli((size, size), sectors)
    powers, numbers = [], []
    for number, image in enumerate(images):
        for y in range(0, image.shape[0] - size + 1, size // 2):
            for x in range(0, image.shape[1] - size + 1, size // 2):
                power = rings.power(image[y : y + size, x : x + size])
                if power.min() > 1e-9:  # saturated or blank
                    powers.append(power)
                    numbers.append(number)
    bias = digamma(rings.effective) - np.log(rings.effective)
    variance = polygamma(1, rings.effective)
    matrix = around(rings.frequency, rings.direction, terms, 0 if sectors == 1 else TURNS)
    return Spectra(np.log(np.array(powers)) - bias, matrix, variance, np.array(numbers))


def fit(groups: Sequence[Spectra], rounds: int = ROUNDS_OF_EM) -> tuple[Floats, Floats, float]:
    """Mean (J,), covariance (J, J) and roughness by expectation maximisation; patches of one size go together."""
    terms = groups[0].basis.shape[1]
    mean, covariance, rough = np.zeros(terms), np.eye(terms), 0.1
    count = sum(len(group.log_power) for group in groups)
    for _ in range(rounds):
        inverse = np.linalg.inv(covariance)
        centres, spreads, misfit = [], np.zeros_like(covariance), 0.0
        for y, matrix, variance, _ in groups:
            weight = 1.0 / (variance + rough)
            spread = np.linalg.inv(inverse + (matrix.T * weight) @ matrix)
            centre = (inverse @ mean + (y * weight) @ matrix) @ spread
            residual = np.sum((y - centre @ matrix.T) ** 2, axis=0)
            residual += len(y) * np.einsum("kj,ji,ki->k", matrix, spread, matrix)
            # Posterior second moment of the rough part of each residual.
            misfit += np.mean(len(y) * rough * variance * weight + (rough * weight) ** 2 * residual)
            centres.append(centre)
            spreads += len(y) * spread
        mean = np.concatenate(centres).mean(axis=0)
        covariance = np.cov(np.concatenate(centres).T, bias=True) + spreads / count
        rough = float(misfit / count)
    return mean, covariance, float(np.sqrt(rough))


def free_contrast(covariance: Floats) -> Floats:
    """The covariance with the first coefficient wide and independent of the others."""
    free = covariance.copy()
    free[0, :] = free[:, 0] = 0.0
    free[0, 0] = FREE_CONTRAST**2
    return free


def learn(
    groups: Sequence[Spectra], cut: Sequence[Spectra], progress: Callable[[int], object] = lambda photographs: None
) -> TexturePrior:
    """The prior on spectra, of whole annuli and of annuli that are cut into sectors; how far patches are from it is for
    `calib.gross` to learn."""
    mean, covariance, roughness = fit(groups)
    prior = TexturePrior(mean, free_contrast(covariance), roughness, misfit=EVERY, gross=0.0)
    mean, covariance, roughness = fit(cut)
    second, terms = covariance + np.outer(mean, mean), len(prior.mean)
    alpha, beta, four = (second[at : at + TURNS, at : at + TURNS] for at in terms + TURNS * np.arange(3))
    two = 0.5 * (alpha + beta)
    progress(1)
    return replace(prior, turned=turning(prior, two, four, roughness))


def _learn_without(
    photograph: int, groups: Sequence[Spectra], cut: Sequence[Spectra], progress: Callable[[int], object]
) -> TexturePrior:
    """The prior of all other photographs."""
    kept, kept_cut = ([group.without(photograph) for group in each] for each in (groups, cut))
    return learn(kept, kept_cut, progress)


def main() -> None:
    """Learn from a folder and write the numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of sharp photographs (PNG, sRGB)")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--table", default="lab16mm", help="for gross errors (default lab16mm)")
    parser.add_argument("--terms", type=int, default=10, help="coefficients of ln S (default 10)")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    from tqdm import tqdm

    try:
        photographs = sorted(arguments.folder.glob("*.png"))
        if not photographs:
            raise PsflutError(f"no PNG photographs in {arguments.folder}; check the folder")
        images = [shrink(read_image(path, srgb=True).image) for path in photographs]
        groups, cut = ([spectra(images, size, arguments.terms, n) for size in SIZES] for n in (1, SECTORS))
        rng = np.random.default_rng(arguments.seed)
        with tqdm(total=len(images) * (1 + 2 * ROUNDS), unit="photograph", disable=None) as bar:
            others = [_learn_without(k, groups, cut, bar.update) for k in range(len(images))]
            table = read_table(arguments.table)
            misfit, gross = learn_gross(others, images, table, rng, bar.update)
            by_sector = learn_gross(others, images, table, rng, bar.update, SECTORS)
        prior = learn(groups, cut)
        terms, turned = len(prior.mean), prior.over(SECTORS)
        two, four = (turned.covariance[at : at + TURNS, at : at + TURNS] for at in (terms, terms + 2 * TURNS))
        numbers = {
            "mean": prior.mean.tolist(),
            "covariance": prior.covariance.tolist(),
            "roughness": prior.roughness,
            "misfit": misfit,
            "gross": gross,
            "sectors": {
                "two": two.tolist(),
                "four": four.tolist(),
                "roughness": turned.roughness,
                "misfit": by_sector[0],
                "gross": by_sector[1],
            },
            "provenance": {
                "patches": sum(len(group.log_power) for group in groups),
                "folder": arguments.folder.name,
                "photographs": len(photographs),
                "sha256": hashlib.sha256(b"".join(path.read_bytes() for path in photographs)).hexdigest(),
                "encoding": "sRGB made linear, luminance, 2 x 2 means",
                "gross": f"95 % intervals on {arguments.table}, noise 0.005, seed {arguments.seed}",
            },
        }
        with staged(arguments.output, overwrite=True) as stage:
            stage.write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    except PsflutError as error:
        print(error, file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
