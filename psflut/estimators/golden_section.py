"""The thesis' method: blind deconvolution, a measure of focus, golden-section search. Reported as it is."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from psflut.density import Mode
from psflut.errors import PsflutError
from psflut.estimation import AbstractEstimator, Curve, Estimate, Outcome, Problem
from psflut.focus import focus_measure, gaussian_window, noise_power
from psflut.imagers.laplacian import Laplacian
from psflut.imagers.plain import Plain
from psflut.reblur import blurred
from psflut.restore import blind_richardson_lucy, nonnegative, wiener

Floats = NDArray[np.floating]
Cost = Callable[[float], float]
Restorer = Callable[[float], Floats]

GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
CURVE_NODES = 33


@dataclass(frozen=True)
class GoldenSection(AbstractEstimator):
    """Accelerated blind Richardson-Lucy, then the distance whose reblurring has the capture's focus.

    The ideal image f is restored blindly, and C(z) = (Phi{h(z) * f} - Phi{g})^2 (4.2.7) is minimised over the
    table's span by golden-section search (Algorithm 1), which returns its lower end a. Phi is the power of the
    tapered image (4.2.10), the same Gaussian window on both images, their mean removed; with a plain imager it is
    taken of their Laplacian, as the thesis takes it of a Laplacian imager's output.

    A capture that falls below zero by more than noise is signed, and is mapped by its own minimum and maximum
    to [0, 1] before Richardson-Lucy; what noise alone takes below zero is set to zero, as deconvblind does.
    With a known scene (the ideal image), nothing is restored: figures 5.2.5 to 5.2.7.

    Known to fail: with ``start="flat"`` the answer follows the size of the starting PSF, hardly the object.

    The interval is the scatter (Student's t) over captures with re-drawn noise, simulated from the restored
    image at the distance found. It knows nothing of the bias and is marked uncalibrated in ``stats``.

    Parameters
    ----------
    start : "flat", "table" or "wiener"
        Flat: ones of the size of the set-up's blurring filter, the table's size where none is named. The thesis'
        closing recommendations, read literally: blind restoration from the tabled PSF of every candidate, or
        Wiener inversion with it; then the same cost and search.
    subtract_noise : bool
        Subtract the noise's expected power from Phi{g}.
    iterations : int
        Of blind Richardson-Lucy.
    window : float
        Standard deviation of the window, in fractions of each side.
    tolerance : float
        Of the search, in fractions of the span.
    redraws : int
        Captures for the interval, at least 2.
    seed : int
        Of the re-drawn noise.
    """

    start: Literal["flat", "table", "wiener"] = "flat"
    subtract_noise: bool = False
    iterations: int = 20
    window: float = 0.35
    tolerance: float = 0.001
    redraws: int = 8
    seed: int = 0

    uses_scene: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.redraws < 2 or self.iterations < 1 or not 0 < self.tolerance < 1 or self.seed < 0:
            raise PsflutError(
                "golden_section needs redraws >= 2, iterations >= 1, a tolerance between 0 and 1 and a seed >= 0, "
                f"got {self.redraws}, {self.iterations}, {self.tolerance} and {self.seed}"
            )

    def solve(self, problem: Problem) -> Estimate:
        """See `AbstractEstimator`."""
        near, far = problem.table.span
        problem = _lit(problem)
        cost, restore = self._cost(problem)
        distance, visited = golden_section(cost, near, far, self.tolerance)
        restored = restore(distance)
        scatter = self._scatter(problem, blurred(restored, problem.table.at(distance)))
        half = stats.t.ppf(0.5 + problem.level / 2, self.redraws - 1) * max(scatter, self.tolerance * (far - near))
        # A restoration for every candidate makes a full curve dear: then it shows what the search saw.
        nodes = np.array(visited) if self._restores_each(problem) else np.linspace(near, far, CURVE_NODES)
        outcome, notes = _edge(distance, near, far, self.tolerance)
        return Estimate(
            distance=distance,
            interval=(float(max(distance - half, near)), float(min(distance + half, far))),
            level=problem.level,
            outcome=outcome,
            modes=(Mode(distance, 1.0),),
            curve=Curve(nodes, np.array([cost(z) for z in nodes]), "cost (4.2.7)"),
            stats={"interval": "uncalibrated: scatter over re-drawn noise", "scatter": scatter, **notes},
            detail={"restored": restored},
        )

    def _cost(self, problem: Problem) -> tuple[Cost, Restorer]:
        """C(z), and the ideal image (H, W) as restored for a candidate z (metres)."""
        window = gaussian_window(problem.shape, self.window)
        edges = Plain() if problem.imager.signed else Laplacian()
        restore = self._restorer(problem)

        def measure(image: Floats) -> float:
            return float(focus_measure(edges.response(image), window))

        target = measure(problem.image)
        if self.subtract_noise:
            target -= noise_power(window, problem.noise.read, edges.kernel())

        def cost(distance: float) -> float:
            return (measure(blurred(restore(distance), problem.table.at(distance))) - target) ** 2

        return cost, restore

    def _restores_each(self, problem: Problem) -> bool:
        return problem.scene is None and self.start != "flat"

    def _restorer(self, problem: Problem) -> Restorer:
        image, table = problem.image, problem.table
        if self._restores_each(problem) and self.start == "table":
            return lambda z: blind_richardson_lucy(image, table.at(z), self.iterations)[0]
        if self._restores_each(problem):
            variance = problem.noise.read**2
            ratio = variance / max(float(image.var()) - variance, variance)
            return lambda z: wiener(image, table.at(z), ratio)
        known: Floats | None = problem.scene
        if known is None:
            size = table.provenance.get("capture", {}).get("filter_size") or table.size
            known = blind_richardson_lucy(image, np.full((size, size), 1.0 / size**2), self.iterations)[0]
        return lambda z: known

    def _scatter(self, problem: Problem, clean: Floats) -> float:
        """Standard deviation (metres) of the answers to captures with noise re-drawn on a clean one."""
        rng = np.random.default_rng(self.seed)
        answers = []
        for _ in range(self.redraws):
            noisy = clean + problem.noise.read * rng.standard_normal(clean.shape)
            cost, _ = self._cost(_lit(replace(problem, image=noisy)))
            answers.append(golden_section(cost, *problem.table.span, self.tolerance)[0])
        return float(np.std(answers, ddof=1))


def _lit(problem: Problem) -> Problem:
    """The problem as Richardson-Lucy can take it: non-negative, its noise scaled alike."""
    if problem.scene is not None:
        return problem
    image, scale = nonnegative(problem.image, problem.noise.read)
    image = image.astype(np.float32)  # half the time; the distance moves by less than the search's tolerance
    return replace(problem, image=image, noise=replace(problem.noise, read=problem.noise.read * scale))


def golden_section(cost: Cost, near: float, far: float, tolerance: float) -> tuple[float, list[float]]:
    """Algorithm 1 of the thesis on [0, 1], mapped to [near, far]: its answer a, and all points probed.

    The printed "b <- 0" is read as 1. Assumes a cost with one minimum; the minimum then lies between a and
    a + tolerance.
    """
    probed: dict[float, float] = {}

    def at(x: float) -> float:
        distance = near + x * (far - near)
        if distance not in probed:
            probed[distance] = cost(distance)
        return probed[distance]

    a, b = 0.0, 1.0
    c, d = GOLDEN**2, GOLDEN
    while abs(a - b) > tolerance:
        if at(c) < at(d):
            b, d = d, c
            c = a + (b - a) * GOLDEN**2
        else:
            a, c = c, d
            d = a + (b - a) * GOLDEN
    return near + a * (far - near), sorted(probed)


def _edge(distance: float, near: float, far: float, tolerance: float) -> tuple[Outcome, dict[str, Any]]:
    reach = 2 * tolerance * (far - near)
    if distance - near < reach or far - distance < reach:
        return Outcome.AT_EDGE, {"edge": "near" if distance - near < reach else "far"}
    return Outcome.OK, {}
