"""`psflut demo`: the whole story on a photograph."""

from pathlib import Path
from typing import Annotated

import typer

from psflut.cli import console


def run(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the figures.")] = Path("psflut-demo"),
) -> None:
    """The whole story on a photograph: captures, every estimator side by side, figures."""
    from tqdm import tqdm

    from psflut import demo as story

    rows = list(tqdm(story.run(output), total=story.STEPS, unit="estimate", disable=None))
    console.print_rows([story.HEADINGS, *rows])
    console.say(f"figures and results.csv are in {output}")
