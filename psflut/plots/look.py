"""What all figures share: fonts, colours that colour-blind readers tell apart, and how they are shown and saved."""

import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from psflut.errors import PsflutError
from psflut.files import refuse_overwrite, staged
from psflut.trial import KNOWN

Floats = NDArray[np.floating]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Of Okabe and Ito, in the order in which methods take them."""

Palette = Mapping[str, str]

TRUTH, INK = "#222222", "#444444"
LOOK: Any = {
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "figure.dpi": 120,
    "savefig.dpi": 160,
    "image.cmap": "gray",
    "axes.formatter.min_exponent": 4,  # 0.1 and 40 on axes of logarithms, not powers of ten
}


def palette_of(methods: Iterable[str]) -> dict[str, str]:
    """The methods in the order in which they come, each with its colour; the same one whether told the scene or not."""
    names = list(dict.fromkeys(methods))
    base = list(dict.fromkeys(name.removesuffix(KNOWN) for name in names))
    return {name: COLOURS[base.index(name.removesuffix(KNOWN)) % len(COLOURS)] for name in names}


class Plot(Figure):
    """A Figure that shows itself in a notebook, whether or not pyplot was ever imported."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        with mpl.rc_context(LOOK):
            self.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
        return buffer.getvalue()


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Draw a figure in the shared look."""

    @wraps(draw)
    def wrapper(*args: Any, **kwargs: Any) -> Figure:
        with mpl.rc_context(LOOK):
            return draw(*args, **kwargs)

    return wrapper


def middle(psfs: Sequence[Floats]) -> list[Floats]:
    """PSFs without the rims in which no pixel of any has a hundredth of its peak: all alike, their middles kept."""
    offsets = [np.argwhere(psf > 0.01 * psf.max()) - psf.shape[0] // 2 for psf in psfs]
    reach = 2 + max(int(np.abs(each).max()) for each in offsets)
    rims = [max(psf.shape[0] // 2 - reach, 0) for psf in psfs]
    return [psf[rim : len(psf) - rim, rim : len(psf) - rim] for psf, rim in zip(psfs, rims, strict=True)]


def check_figure(path: Path, overwrite: bool) -> None:
    """Refuse, before the work, a path that `save` would refuse after it."""
    if path.suffix.lower() not in (".png", ".pdf"):
        raise PsflutError(f"a figure's name ends in .png or .pdf, got {str(path)!r}; choose one of them")
    refuse_overwrite(path, overwrite)


def save(figure: Figure, path: Path, overwrite: bool = True) -> None:
    """Write a figure whole or not at all; without a date, so the same figure gives the same bytes."""
    check_figure(path, overwrite)
    kind = path.suffix.lstrip(".").lower()
    metadata = {"CreationDate": None} if kind == "pdf" else {"Software": None}
    with mpl.rc_context(LOOK), staged(path, overwrite) as stage:
        figure.savefig(stage, format=kind, metadata=metadata)
