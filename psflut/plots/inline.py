"""Figures and pictures as text of an HTML page that needs no other file, in the page's own colours."""

import base64
import io
import re
from collections.abc import Mapping
from html import escape

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from psflut.plots.look import COLOURS, INK, LOOK, TRUTH

VARIABLES: Mapping[str, str] = {colour.lower(): f"var(--c{k})" for k, colour in enumerate(COLOURS)} | {
    INK.lower(): "var(--ink)",
    TRUTH.lower(): "var(--ink)",
    "#000000": "var(--ink)",
    "#ffffff": "var(--paper)",
}
"""Colours of the shared look that a page may redefine, for light and dark."""

NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}


def svg(figure: Figure, name: str, words: str) -> str:
    """A figure as an SVG element: equal figures of equal names give equal text.

    Parameters
    ----------
    name : str
        Keeps the element's ids apart from those of other figures on a page.
    words : str
        What the figure shows, for those who cannot see it.
    """
    buffer = io.StringIO()
    with mpl.rc_context({**LOOK, "svg.hashsalt": name, "svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", transparent=True, metadata=NO_METADATA)
    text = buffer.getvalue()
    drawn = text[text.index("<svg") :].strip()
    for pattern, count in (
        (r' xmlns(:\w+)?="[^"]*"', 2),
        (r' (width|height)="[\d.]+pt"', 2),
        (r'(?<=<g) id="[\w.]+"', 0),
    ):
        drawn = re.sub(pattern, "", drawn, count=count)
    drawn = re.sub(r"#[0-9a-f]{6}\b", lambda found: VARIABLES.get(found[0], found[0]), drawn)
    label = escape(words, quote=True)
    return drawn.replace("<svg ", f'<svg role="img" aria-label="{label}" ', 1)


def png(image: NDArray[np.floating]) -> str:
    """A grey image as a data URL, from its 1st to its 99th percentile."""
    from PIL import Image

    low, high = np.percentile(image, [1, 99])
    levels = np.rint(255 * np.clip((image - low) / max(high - low, 1e-9), 0, 1)).astype(np.uint8)
    buffer = io.BytesIO()
    Image.fromarray(levels).save(buffer, format="PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
