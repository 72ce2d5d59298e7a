"""The printed noise target: a picture that gives every PSF light at all frequencies, and discs to find it by."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from psflut.errors import PsflutError
from psflut.fourier import frequency

Floats = NDArray[np.float64]

PAGES = {"A4": (0.297, 0.210), "A3": (0.420, 0.297), "Letter": (0.2794, 0.2159)}
"""Height and width, metres."""

CELL, DOTS = 0.5e-3, 3
"""Side of the finest cell, metres, and dots of the digital picture to a cell."""

SIDE, FOOT = 0.015, 0.032
"""Margins of the page: left, right and top; and at the foot, where the words are; metres."""

DISC, CLEAR, AROUND = 0.015, 0.026, 0.008
"""Diameter of a disc, side of the white square that it stands in, and white around the field; metres."""

SLOPE = 1.5
"""Power falls as (spatial frequency)^-SLOPE before the picture is made black and white."""

LIKE, PEAKS = 0.5, 7
"""Least correlation of a frame with a disc, and with the noise; how many places are tried at a scale."""


@dataclass(frozen=True)
class NoiseTarget:
    """Black and white noise with a disc in every corner, for a page that is printed at any size.

    Black and white, as neither a printer's tones nor a camera's encoding change that. Gaussian noise whose power
    falls as k^-1.5 is cut at its median. White cells have most power at the finest scale, and go grey from afar.
    The error of a PSF, as the root mean of 1 / power over the frequencies of a pixel, was for pixels of 0.3, 0.5,
    1 and 2 mm on the page: 3, 3, 5, 10 with white cells; 3, 3, 4, 6 with k^-1; 4, 3, 4, 5 with k^-1.5;
    7, 4, 5, 5 with k^-2. The discs are found under any blur, as a symmetric one leaves them where they are.

    Parameters
    ----------
    page : str
        A4, A3 or Letter.
    seed : int
        Of the noise.
    """

    page: str = "A4"
    seed: int = 0

    def __post_init__(self) -> None:
        if self.page not in PAGES:
            raise PsflutError(f"a page is one of {', '.join(PAGES)}, got {self.page!r}; choose one")
        if self.seed < 0:
            raise PsflutError(f"a seed is a whole number from 0, got {self.seed}; choose another")

    @classmethod
    def parse(cls, text: str) -> "NoiseTarget":
        """From its name: noise, noise:A4 or noise:A4:7."""
        head, *rest = text.split(":")
        if head != "noise" or len(rest) > 2 or not all(word.isdecimal() for word in rest[1:]):
            raise PsflutError(f"a noise target is named as on its foot, noise:A4:0 say, got {text!r}; copy that name")
        page, seed = [*rest, *("A4", "0")[len(rest) :]]
        return cls(page, int(seed))

    @property
    def name(self) -> str:
        """What `parse` reads back."""
        return f"noise:{self.page}:{self.seed}"

    @property
    def cells(self) -> tuple[int, int]:
        """Rows and columns of the field."""
        height, width = PAGES[self.page]
        return round((height - SIDE - FOOT) / CELL), round((width - 2 * SIDE) / CELL)

    def picture(self) -> Floats:
        """The field and some white around it: 1 is white, 0 black; DOTS to a CELL. Not to be written to."""
        return _picture(self)

    @property
    def discs(self) -> Floats:
        """Middles of the discs in the picture, clockwise from the upper left, (y, x) in dots: (4, 2)."""
        near = _dots(AROUND) + _dots(CLEAR) / 2 - 0.5
        bottom, right = (n * DOTS + 2 * _dots(AROUND) - 1 - near for n in self.cells)
        return np.array([[near, near], [near, right], [bottom, right], [bottom, near]])

    def find(self, frame: Floats) -> Floats:
        """Where a frame shows it: (3, 3), from (x, y, 1) of the frame to that of the picture, to a pixel or two.

        A disc in white is looked for at all scales by normalised correlation. Four of one scale that lie as the
        picture's do are taken for its corners, and of all such fours the one whose picture is most like the frame.

        Raises
        ------
        PsflutError
            If there is none.
        """
        from skimage.transform import ProjectiveTransform

        drawn = self.picture()
        picture = ndimage.zoom(ndimage.uniform_filter(drawn, 4 * DOTS), 0.25 / DOTS, order=1)
        shrunk = (np.array(picture.shape) - 1) / (np.array(drawn.shape) - 1)
        best, matrix = LIKE, None
        for corners in _fours(frame, self.discs):
            map_ = ProjectiveTransform.from_estimate(corners[:, ::-1], self.discs[:, ::-1])
            likeness = _likeness(frame, picture, np.diag([*shrunk[::-1], 1.0]) @ map_.params) if map_ else 0.0
            if likeness > best:
                best, matrix = likeness, map_.params
        if matrix is None:
            raise PsflutError("shows no noise target; all four discs and the white around them must be seen")
        return np.asarray(matrix)


@lru_cache(maxsize=2)
def _picture(target: NoiseTarget) -> Floats:
    """Kept, as every frame asks for it."""
    rows, columns = target.cells
    noise = np.random.default_rng(target.seed).standard_normal((rows, columns))
    cycles = frequency((rows, columns))
    cycles[0, 0] = np.inf
    field = fft.irfft2(fft.rfft2(noise) * cycles ** (-SLOPE / 2.0), noise.shape)
    white = np.pad(np.kron(field > np.median(field), np.ones((DOTS, DOTS))), _dots(AROUND), constant_values=1.0)
    y, x = np.indices(white.shape)
    for disc in target.discs:
        square = np.maximum(np.abs(y - disc[0]), np.abs(x - disc[1])) < _dots(CLEAR) / 2
        white[square] = np.hypot(y - disc[0], x - disc[1])[square] > _dots(DISC) / 2
    white.flags.writeable = False
    return white


def _dots(length: float) -> int:
    return round(length / CELL) * DOTS


def _fours(frame: Floats, discs: Floats) -> list[Floats]:
    """Fours of places (y, x) in a frame that may be the discs, in every order that turns may give them."""
    out = []
    sides = np.linalg.norm(np.roll(discs, -1, axis=0) - discs, axis=1)
    for diameter in 6.0 * 1.15 ** np.arange(30):
        if 6 * diameter > min(frame.shape):
            break
        places = _places(frame, diameter)
        expected = sides * diameter / _dots(DISC)
        for four in combinations(places, 4):
            corners = np.array(four)
            away = corners - corners.mean(axis=0)
            corners = corners[np.argsort(np.arctan2(away[:, 0], away[:, 1]))]  # clockwise, as y is down
            for turn in range(4):
                turned = np.roll(corners, turn, axis=0)
                ratio = np.linalg.norm(np.roll(turned, -1, axis=0) - turned, axis=1) / expected
                if ratio.min() > 0.7 and ratio.max() < 1.4:
                    out.append(turned)
    return out


def _places(frame: Floats, diameter: float) -> Floats:
    """Where black discs of that diameter (pixels) stand in white, (n, 2), the most alike first."""
    from skimage.feature import match_template, peak_local_max
    from skimage.transform import resize

    across = min(diameter, 12.0)
    shape = np.maximum(np.rint(np.array(frame.shape) * across / diameter), 1).astype(int)
    small = resize(frame, shape, anti_aliasing=True)
    half = int(across * CLEAR / DISC / 2)
    line = np.arange(-half, half + 1)
    disc = np.clip(np.hypot(line[:, None], line) - across / 2 + 0.5, 0.0, 1.0)
    like = match_template(small, disc, pad_input=True, mode="edge")
    peaks = peak_local_max(like, min_distance=half, threshold_abs=LIKE, num_peaks=PEAKS, exclude_border=False)
    return np.asarray([(_top(like, peak) + 0.5) * np.array(frame.shape) / shape - 0.5 for peak in peaks])


def _top(like: Floats, peak: NDArray[np.int_]) -> Floats:
    """The peak by parabolas through its neighbours."""
    y, x = np.clip(peak, 1, np.array(like.shape) - 2)
    lines = like[y - 1 : y + 2, x], like[y, x - 1 : x + 2]
    steps = [0.5 * (a - c) / min(a - 2 * b + c, -1e-9) for a, b, c in lines]
    return np.asarray(np.add([y, x], np.clip(steps, -0.5, 0.5)), dtype=float)


def _likeness(frame: Floats, picture: Floats, matrix: Floats) -> float:
    """Correlation of a frame with the noise of a picture, discs and what varies slowly left out."""
    y, x = (np.linspace(0.05 * n, 0.95 * n, 64) for n in picture.shape)
    down, across = np.meshgrid(y, x, indexing="ij")
    back = np.linalg.inv(matrix) @ np.array([across.ravel(), down.ravel(), np.ones(across.size)])
    where = (back[1::-1] / back[2]).reshape(2, *across.shape)
    if (where < 0).any() or (where[0] > frame.shape[0] - 1).any() or (where[1] > frame.shape[1] - 1).any():
        return 0.0
    ours = ndimage.map_coordinates(frame, where, order=1)
    theirs = ndimage.map_coordinates(picture, np.array([down, across]), order=1)
    middle = np.maximum(np.abs(down / picture.shape[0] - 0.5), np.abs(across / picture.shape[1] - 0.5)) < 0.32
    parts = [
        (ndimage.gaussian_filter(each, 1.0) - ndimage.gaussian_filter(each, 6.0))[middle] for each in (ours, theirs)
    ]
    return float(np.corrcoef(*parts)[0, 1]) if min(np.std(part) for part in parts) > 0 else 0.0
