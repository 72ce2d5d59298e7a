"""Richardson-Lucy with a known PSF."""

import numpy as np
from numpy.typing import NDArray

from psflut.reblur import blur
from psflut.restore.intake import checked
from psflut.restore.steps import LEAST, Path, ratio, rounding

Reals = NDArray[np.floating]


def richardson_lucy(
    image: Reals,
    psf: Reals,
    iterations: int,
    *,
    start: Reals | None = None,
    acceleration: bool = True,
    filter_epsilon: float = 0.0,
) -> Reals:
    """Maximum likelihood restoration under Poisson noise with a known PSF (Richardson 1972, Lucy 1974).

    f <- f corr(h, g / (h * f)) (4.2.6), divided by the share of each scene pixel's light that falls inside
    the image. With `acceleration` each step starts from a prediction (`Path`). Few iterations regularise.

    Parameters
    ----------
    image : (H, W) array
        Capture g, non-negative: map a signed one by its minimum and maximum to [0, 1] before.
    psf : (K, K) array
        h, non-negative, sum 1, centred on K // 2, K odd.
    iterations : int
        Number of steps.
    start : (H, W) array, optional
        First estimate, non-negative; flat by default.
    filter_epsilon : float
        Where h * f is below it, g / (h * f) counts as 0, as in scikit-image.

    Returns
    -------
    (H, W) non-negative array in the units of the image.

    Raises
    ------
    PsflutError
        For arrays of a wrong shape, values that are not finite or negative, or a PSF that does not sum to 1.
    """
    image, psf = checked(image, psf, positive=True)
    first = np.full_like(image, image.mean()) if start is None else np.asarray(start, image.dtype)
    first, _ = checked(first, psf, positive=True)
    reblur = blur(psf, (image.shape[0], image.shape[1]))
    seen = reblur.pulled(np.ones_like(image))
    share, unseen = 1 / np.maximum(seen, LEAST), np.flatnonzero(seen <= LEAST)
    path, least = Path(reblur.laid(first)), rounding(image)
    for _ in range(iterations):  # in place: new arrays of this size cost half a transform each
        guess = path.prediction() if acceleration else path.now
        now = reblur.pulled(ratio(image, reblur.seen(guess), least, filter_epsilon))
        now *= share
        now.put(unseen, 1)
        now *= guess
        path = path.moved(guess, now) if acceleration else Path(now)
    return reblur.cut(path.now)
