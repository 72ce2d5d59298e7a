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
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, polygamma

from calib.efficiency import learn_efficiency
from psflut.errors import PsflutError
from psflut.files import staged
from psflut.images import read_image
from psflut.spectrum import annular_power, annuli
from psflut.store import read_table
from psflut.table import PSFTable
from psflut.texture import TexturePrior, basis

Floats = NDArray[np.float64]

SIZES = (64, 128, 256)
"""Sides of the patches learnt from, pixels."""

FREE_CONTRAST = 3.0
"""Standard deviation of the prior on theta_0, in nats: a factor of 20 in power either way."""


class Sample(NamedTuple):
    """ln power of one patch, the basis at its frequencies, and the sampling variance of ln power."""

    log_power: Floats
    basis: Floats
    variance: Floats


def shrink(image: Floats) -> Floats:
    """Means of 2 x 2 pixels: a photograph's own blur halves."""
    height, width = (n - n % 2 for n in image.shape)
    return np.asarray(image[:height, :width].reshape(height // 2, 2, width // 2, 2).mean(axis=(1, 3)))


def samples(image: Floats, sizes: tuple[int, ...], terms: int) -> list[Sample]:
    """Half-overlapping square patches of those sides (pixels) of a sharp image; flat ones are left out."""
    out = []
    for size in sizes:
        rings = annuli((size, size))
        shift, variance = digamma(rings.effective) - np.log(rings.effective), polygamma(1, rings.effective)
        for y in range(0, image.shape[0] - size + 1, size // 2):
            for x in range(0, image.shape[1] - size + 1, size // 2):
                power = annular_power(image[y : y + size, x : x + size])
                if power.min() > 1e-9:  # saturated or blank
                    out.append(Sample(np.log(power) - shift, basis(rings.frequency, terms), variance))
    return out


def fit(patches: list[Sample], rounds: int = 200) -> tuple[Floats, Floats, float]:
    """Mean (J,), covariance (J, J) and roughness by expectation maximisation."""
    terms = patches[0].basis.shape[1]
    mean, covariance, rough = np.zeros(terms), np.eye(terms), 0.1
    for _ in range(rounds):
        inverse = np.linalg.inv(covariance)
        centres, spreads, misfit = [], [], []
        for y, matrix, variance in patches:
            weight = 1.0 / (variance + rough)
            spread = np.linalg.inv(inverse + (matrix.T * weight) @ matrix)
            centre = spread @ (inverse @ mean + matrix.T @ (weight * y))
            residual = (y - matrix @ centre) ** 2 + np.einsum("kj,ji,ki->k", matrix, spread, matrix)
            # Posterior second moment of the rough part of each residual.
            misfit.append(np.mean(rough * variance * weight + (rough * weight) ** 2 * residual))
            centres.append(centre)
            spreads.append(spread)
        mean = np.mean(centres, axis=0)
        covariance = np.cov(np.array(centres).T, bias=True) + np.mean(spreads, axis=0)
        rough = float(np.mean(misfit))
    return mean, covariance, float(np.sqrt(rough))


def free_contrast(covariance: Floats) -> Floats:
    """The covariance with the first coefficient wide and independent of the others."""
    free = covariance.copy()
    free[0, :] = free[:, 0] = 0.0
    free[0, 0] = FREE_CONTRAST**2
    return free


def learn(images: Sequence[Floats], terms: int, table: PSFTable, rng: np.random.Generator) -> TexturePrior:
    """All numbers of the prior from sharp images; the table is what the efficiency is judged with."""
    patches = [patch for image in images for patch in samples(image, SIZES, terms)]
    mean, covariance, roughness = fit(patches)
    prior = TexturePrior(mean, free_contrast(covariance), roughness, 1.0, {"patches": len(patches)})
    return replace(prior, efficiency=learn_efficiency(prior, images, table, rng))


def main() -> None:
    """Learn from a folder and write the numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of sharp photographs (PNG, sRGB)")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--table", default="lab16mm", help="for the efficiency (default lab16mm)")
    parser.add_argument("--terms", type=int, default=6, help="coefficients of ln S (default 6)")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    try:
        photographs = sorted(arguments.folder.glob("*.png"))
        if not photographs:
            raise PsflutError(f"no PNG photographs in {arguments.folder}; check the folder")
        images = [shrink(read_image(path, srgb=True).image) for path in photographs]
        table = read_table(arguments.table)
        prior = learn(images, arguments.terms, table, np.random.default_rng(arguments.seed))
        numbers = {
            "mean": prior.mean.tolist(),
            "covariance": prior.covariance.tolist(),
            "roughness": prior.roughness,
            "efficiency": prior.efficiency,
            "provenance": {
                **prior.provenance,
                "folder": arguments.folder.name,
                "photographs": len(photographs),
                "sha256": hashlib.sha256(b"".join(path.read_bytes() for path in photographs)).hexdigest(),
                "encoding": "sRGB made linear, luminance, 2 x 2 means",
                "efficiency": f"68 % intervals on {arguments.table}, noise 0.005, seed {arguments.seed}",
            },
        }
        with staged(arguments.output, overwrite=True) as stage:
            stage.write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    except PsflutError as error:
        print(error, file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
