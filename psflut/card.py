"""A small card of HTML for notebooks: a heading, rows of names and words, and a strip with an interval on it."""

from collections.abc import Iterable
from html import escape

STYLE = (
    "display:inline-block;font:14px/1.5 system-ui,sans-serif;border:1px solid #8886;border-radius:8px;"
    "padding:.6em 1em;max-width:26em"
)


def card(heading: str, rows: Iterable[tuple[str, str]], picture: str = "", note: str = "") -> str:
    """HTML of the card; all words are escaped, `picture` is HTML already."""
    cells = "".join(
        f'<tr><td style="text-align:left;opacity:.7;padding:0 1em 0 0">{escape(name)}</td>'
        f'<td style="text-align:left">{escape(words)}</td></tr>'
        for name, words in rows
    )
    below = f'<div style="margin-top:.4em">{escape(note)}</div>' if note else ""
    return (
        f'<div style="{STYLE}"><div style="font-size:1.5em;font-weight:600">{escape(heading)}</div>{picture}'
        f'<table style="border:0;margin:0">{cells}</table>{below}</div>'
    )


def strip(span: tuple[float, float], interval: tuple[float, float], marks: Iterable[tuple[float, float]]) -> str:
    """A line for the span, a bar for the interval on it, a dot for every mark (its place and weight)."""
    first, last = span

    def place(value: float) -> float:
        return 4 + 292 * min(max((value - first) / (last - first), 0.0), 1.0)

    near, far = (place(end) for end in interval)
    dots = "".join(
        f'<circle cx="{place(at):.1f}" cy="8" r="{2 + 2 * weight:.1f}" fill="#D55E00"/>' for at, weight in marks
    )
    words = escape(f"interval within {first:.3g} to {last:.3g} m", quote=True)
    return (
        f'<svg viewBox="0 0 300 16" width="300" height="16" style="max-width:100%" role="img" aria-label="{words}">'
        f'<line x1="4" x2="296" y1="8" y2="8" stroke="#8888" stroke-width="2"/>'
        f'<rect x="{near:.1f}" y="4" width="{max(far - near, 1):.1f}" height="8" rx="2" fill="#0072B2" '
        f'fill-opacity=".55"/>{dots}</svg>'
    )
