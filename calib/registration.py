"""Where a frame shows a known picture: coarsely by correlation, then far below a pixel together with its blur."""

import numpy as np
from numpy.typing import NDArray
from scipy import fft, linalg, ndimage

from psflut.errors import PsflutError

Floats = NDArray[np.float64]

TILE, LEAST_TILES = 64, 6
"""Side of the tiles that are looked for, pixels, and how many must agree."""


def place(matrix: Floats, y: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Where the pixels (y, x) of a frame lie in the picture: a homography of (x, y, 1), 3 x 3."""
    below = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2]
    across = (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]) / below
    return (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2]) / below, across


def covered(shape: tuple[int, ...], matrix: Floats, y: Floats, x: Floats, margin: int = 3) -> NDArray[np.bool_]:
    """Whether the crossings of lines y (h,) and x (w,) of a frame lie in a picture of a shape, clear of its border."""
    where = place(matrix, y[:, None], x[None, :])
    sides = zip(where, shape, strict=True)
    return np.asarray(np.all([(at >= margin) & (at <= n - 1 - margin) for at, n in sides], axis=0))


def splines(picture: Floats) -> Floats:
    """What `sample` takes: coefficients of splines of order 5."""
    return np.asarray(ndimage.spline_filter(picture, order=5))


def sample(coefficients: Floats, matrix: Floats, y: Floats, x: Floats) -> Floats:
    """The picture of these `splines` at the crossings of lines y (h,) and x (w,) of a frame."""
    where = np.array(place(matrix, y[:, None], x[None, :]))
    return np.asarray(ndimage.map_coordinates(coefficients, where, order=5, mode="nearest", prefilter=False))


def pixel_mean(picture: Floats, matrix: Floats, middle: tuple[float, float]) -> Floats:
    """The mean over the pixel of a frame around every point of a picture that is made of square dots.

    The pixel is a parallelogram in the picture, taken at the `middle` (y, x) of the frame.
    """
    y, x = middle
    ends = [place(matrix, np.array(y + dy), np.array(x + dx)) for dy, dx in ((0.5, 0), (-0.5, 0), (0, 0.5), (0, -0.5))]
    down, across = np.subtract(ends[0], ends[1]), np.subtract(ends[2], ends[3])
    margin = int(np.ceil(2 * max(np.abs(down).max(), np.abs(across).max()))) + 1
    padded = np.pad(picture, margin, mode="edge")
    shape = tuple(fft.next_fast_len(n, True) for n in padded.shape)
    v, u = fft.fftfreq(shape[0])[:, None], fft.rfftfreq(shape[1])
    transfer = np.sinc(v) * np.sinc(u) * np.sinc(down[0] * v + down[1] * u) * np.sinc(across[0] * v + across[1] * u)
    mean = fft.irfft2(fft.rfft2(padded, shape) * transfer, shape)
    return np.asarray(mean[margin : margin + picture.shape[0], margin : margin + picture.shape[1]])


def coarse(frame: Floats, picture: Floats, grain: float) -> Floats:
    """A picture of nearly the same magnification (some per cent) and direction (some degrees), found in a frame.

    Tiles are found one by one by cross-correlation, which a symmetric blur does not bias; RANSAC makes an affine
    map of those that agree, and the tiles are looked for again in its light.

    Parameters
    ----------
    frame : (H, W) array
        Without NaN.
    picture : (h, w) array
    grain : float
        Sigma of the smoothing before, pixels.

    Returns
    -------
    (3, 3) array
        See `place`.

    Raises
    ------
    PsflutError
        If too few tiles agree.
    """
    from skimage.registration import phase_cross_correlation

    matrix = np.eye(3)
    frame, picture = _even(frame, grain), _even(picture, grain)
    if not (np.std(frame) > 1e-9 and np.std(picture) > 1e-9):
        raise PsflutError("shows one grey, as far as can be seen, or the reference does")
    side = min(*frame.shape, *picture.shape)
    window = np.hanning(side)[:, None] * np.hanning(side)
    starts = [[(n - side) // 2 for n in image.shape] for image in (frame, picture)]
    parts = [image[y : y + side, x : x + side] * window for image, (y, x) in zip((frame, picture), starts, strict=True)]
    shift = phase_cross_correlation(*parts, normalization=None)[0]
    matrix[:2, 2] = (np.array(starts[1]) - starts[0] - shift)[::-1]
    coefficients = splines(picture)
    for _ in range(4):
        matrix = _agreeing(frame, coefficients, matrix)
    return matrix


def _even(image: Floats, grain: float) -> Floats:
    """Less what varies slowly, and the finest grain."""
    smooth = ndimage.gaussian_filter(image, grain)
    return np.asarray(smooth - ndimage.gaussian_filter(image, 25.0))


def _agreeing(frame: Floats, coefficients: Floats, matrix: Floats) -> Floats:
    """The affine map of those tiles that agree."""
    from skimage.measure import ransac
    from skimage.registration import phase_cross_correlation
    from skimage.transform import AffineTransform

    shape, window = frame.shape, np.hanning(TILE)[:, None] * np.hanning(TILE)
    y, x = (np.arange(n, dtype=float) for n in shape)
    warped, known = sample(coefficients, matrix, y, x), covered(coefficients.shape, matrix, y, x)
    inside, outside = [], []
    for top in range(0, shape[0] - TILE + 1, TILE // 2):
        for left in range(0, shape[1] - TILE + 1, TILE // 2):
            ours, theirs = (image[top : top + TILE, left : left + TILE] for image in (frame, warped))
            if not known[top : top + TILE, left : left + TILE].all():
                continue
            shift = phase_cross_correlation(ours * window, theirs * window, upsample_factor=10, normalization=None)[0]
            middle = np.array([top, left]) + (TILE - 1) / 2
            inside.append(middle[::-1])
            outside.append(place(matrix, *(middle - shift))[::-1])
    if len(inside) >= LEAST_TILES:
        rng = np.random.default_rng(0)
        model, good = ransac((np.array(inside), np.array(outside)), AffineTransform, 3, 2.5, max_trials=500, rng=rng)
        if good is not None and good.sum() >= max(LEAST_TILES, 0.3 * len(inside)):
            return np.asarray(model.params)
    raise PsflutError("does not show the reference; take the reference from the same place, with the same lens")


def motions(y: Floats, x: Floats, projective: bool) -> Floats:
    """Displacements (n, 2, h, w), in y and x, of small affine or projective maps on lines y (h,) and x (w,)."""
    v = np.broadcast_to(y[:, None], (len(y), len(x)))
    u = np.broadcast_to(x, v.shape)
    none, one = np.zeros_like(v), np.ones_like(v)
    fields = [(one, none), (none, one), (v, none), (u, none), (none, v), (none, u)]
    fields += [(v * u, u * u), (v * v, v * u)] if projective else []
    return np.array(fields)


def step(change: Floats, projective: bool) -> Floats:
    """The small map (3, 3), of (x, y, 1), whose displacements are `change` times `motions`."""
    dy, dx, yy, yx, xy, xx = change[:6]
    matrix = np.array([[1 + xx, xy, dx], [yx, 1 + yy, dy], [0.0, 0.0, 1.0]])
    if projective:
        matrix[2, :2] = -change[6], -change[7]
    return matrix


def slopes(scene: Floats, y: Floats, x: Floats, projective: bool) -> Floats:
    """What the `motions` would add to a picture on lines y (h,) and x (w,): (n, h, w)."""
    gradient = np.array(np.gradient(scene, y[1] - y[0], x[1] - x[0]))
    return np.asarray(np.einsum("nkyx,kyx->nyx", motions(y, x, projective), gradient))


def refine(frame: Floats, moved: Floats, free: Floats) -> Floats:
    """The displacement, in units of `motions`, that a frame asks for: a Gauss-Newton step with the blur held.

    As the blur that is held is symmetric about its centre, it moves nothing, and how wide it is does not matter.

    Parameters
    ----------
    frame : (H, W) array
        NaN where it is not to be used.
    moved : (n, H, W) array
        The `slopes` of the picture where the map puts it now, as the frame shows them, that is blurred.
    free : (m, H, W) array
        What is fitted as well: the blurred picture times the light, and the background.
    """
    used = np.isfinite(frame)
    design = np.vstack([moved[:, used], free[:, used]]).T
    return np.asarray(linalg.lstsq(design, frame[used])[0][: len(moved)])
