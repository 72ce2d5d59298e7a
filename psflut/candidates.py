"""The evidence of many patches, at as many candidate distances as the posterior of each needs.

Candidates are added between those that are likely, each search for the scene's spectrum starting from its neighbours':
a few over the whole table, all of the table's own fineness where a patch leaves hope, and finer ones around its peak.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from psflut import evidence
from psflut.evidence import Bank
from psflut.laplace import HOPELESS, Fit, integrate

Floats = NDArray[np.float64]

FEW, PARTS, DOUBT = 3, 3, 200.0
"""First the table is in so many parts; they are cut so that two more cuts in `PARTS` make steps of two of the bank's.
The last is done only where a neighbour is no more than so many nats below the best: a strong texture's peak may lie
between two candidates, and of 576 patches 2 had it 120 nats above both."""

MORE, DEPTH = 48, 20.0
"""Candidates that are added where the log evidence is no more than so many nats below its peak."""


class Solution(NamedTuple):
    """A patch's candidates with their evidence, and the misfit of the likeliest."""

    bank: Bank
    fit: Fit
    misfit: float


def solve(power: Floats, noise: Floats, bank: Bank) -> Solution:
    """The evidence of one patch that may not suit the model: its power and its noise's, (K,) each."""
    return solve_all(power[None], noise[None], bank)[0]


def solve_all(power: Floats, noise: Floats, bank: Bank) -> list[Solution]:
    """The evidence of patches of one shape.

    Parameters
    ----------
    power, noise : (B, K) arrays
        Of each patch and of its noise, by annulus.
    bank : Bank
        Its candidates tell how finely the table is to be searched.

    Returns
    -------
    list of Solution
        Candidates ascend in the even coordinate, more of them where they are likely.
    """
    batch = _Batch(power, noise, bank, np.ones(len(power)))
    few = max(2, round((len(bank.even) - 1) / (2 * FEW * PARTS**2)))
    rows = batch.finer(batch.coarse(), few, np.inf)
    rows = batch.finer(batch.finer(rows, PARTS, np.inf), PARTS, DOUBT)
    rows = batch.finer(rows, 2 * PARTS, 0.0)  # a step beside a sharp peak the misfit is too large
    misfit = batch.misfit(rows)
    batch = replace(batch, share=evidence.discount(misfit, bank.prior))
    rows = batch.finer(batch.again(rows), None, DEPTH)
    parts = zip(*(np.split(column, rows.first[1:]) for column in rows), strict=True)
    return [
        Solution(
            replace(bank, even=part.even, attenuation=part.attenuation, shape=share * bank.shape), part.fit, float(m)
        )
        for part, share, m in zip((_Rows(*part) for part in parts), batch.share, misfit, strict=True)
    ]


class _Rows(NamedTuple):
    """Candidates of patches, in order of the patches' numbers and of the even coordinate: (N, ...) arrays."""

    patch: NDArray[np.intp]
    even: Floats
    attenuation: Floats
    log_evidence: Floats
    theta: Floats
    curvature: Floats

    @property
    def fit(self) -> Fit:
        """What was found."""
        return Fit(*self[3:])

    @property
    def first(self) -> NDArray[np.intp]:
        """The row where each patch begins."""
        return np.flatnonzero(np.diff(self.patch, prepend=-1))


@dataclass(frozen=True, eq=False)
class _Batch:
    """Patches of one shape: powers and noise powers (B, K), and the share (B,) at which the bank's shapes count."""

    power: Floats
    noise: Floats
    bank: Bank
    share: Floats

    def coarse(self) -> _Rows:
        """The ends of `FEW` equal parts of the table for every patch."""
        even, count = np.linspace(self.bank.even.min(), self.bank.even.max(), FEW + 1), len(self.power)
        attenuation = np.tile(self.bank.at(even), (count, 1))
        return self._rows(np.repeat(np.arange(count), len(even)), np.tile(even, count), attenuation, None)

    def finer(self, rows: _Rows, parts: int | None, depth: float) -> _Rows:
        """The rows, and others between neighbours of which one is no more than `depth` nats below its patch's best.

        Each gap is cut in so many parts; None cuts it in as many as make `MORE` candidates of all that a patch gets.
        """
        best = np.maximum.reduceat(rows.log_evidence, rows.first)
        likely = rows.log_evidence >= best[rows.patch] - depth
        gaps = np.flatnonzero((likely[:-1] | likely[1:]) & (rows.patch[:-1] == rows.patch[1:]))
        owner = rows.patch[gaps]
        added = MORE // np.bincount(owner)[owner] if parts is None else np.full(len(gaps), parts - 1)
        left = np.repeat(gaps, added)
        nth = 1 + np.arange(len(left)) - np.repeat(np.cumsum(added) - added, added)
        part = nth / (np.repeat(added, added) + 1)
        even = (1 - part) * rows.even[left] + part * rows.even[left + 1]
        theta = (1 - part)[:, None] * rows.theta[left] + part[:, None] * rows.theta[left + 1]
        more = self._rows(rows.patch[left], even, self.bank.at(even), theta)
        order = np.argsort(np.concatenate([np.arange(len(rows.even)), left + part]))
        return _Rows(*(np.concatenate(pair)[order] for pair in zip(rows, more, strict=True)))

    def again(self, rows: _Rows) -> _Rows:
        """The rows of patches whose shapes count for less, worked out anew.

        Hopeless ones keep their spectra, and their log evidence beside the best counts for as much less.
        """
        best = rows.first + np.array([part.argmax() for part in np.split(rows.log_evidence, rows.first[1:])])
        share, below = self.share[rows.patch], rows.log_evidence - rows.log_evidence[best][rows.patch]
        changed = (share < 1) & (share * below > -HOPELESS)
        new = self._rows(rows.patch[changed], rows.even[changed], rows.attenuation[changed], rows.theta[changed])
        for column, values in zip(rows, new, strict=True):
            column[changed] = values
        left = (share < 1) & ~changed
        rows.log_evidence[left] = (rows.log_evidence[best][rows.patch] + share * below)[left]
        return rows

    def misfit(self, rows: _Rows) -> Floats:
        """(B,) misfit of each patch's likeliest candidate."""
        best = np.array([part.argmax() for part in np.split(rows.log_evidence, rows.first[1:])]) + rows.first
        scene = evidence.scene_power(rows.attenuation[best], rows.theta[best], self.bank)
        return evidence.misfit(self.power, scene + self.noise, self.bank.shape)

    def _rows(self, patch: NDArray[np.intp], even: Floats, attenuation: Floats, start: Floats | None) -> _Rows:
        bank = replace(self.bank, attenuation=attenuation, shape=self.share[patch, None] * self.bank.shape)
        fit = integrate(self.power[patch], self.noise[patch], bank, start, patch)
        return _Rows(patch, even, attenuation, fit.log_evidence, fit.theta, fit.curvature)
