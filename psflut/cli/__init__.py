"""The command line: options in, calls, words out, one command a file. No science here.

Results go to stdout (``--json``: one JSON object a line and nothing else), messages and progress to stderr.
Exit 0: done; 2: refused with one sentence; 130: interrupted.
"""

import os
import sys
from importlib import import_module
from typing import Annotated

import typer
from typer.exceptions import TyperException

from psflut.cli import console
from psflut.errors import PsflutError

COMMANDS = (
    "demo",
    "build",
    "target",
    "calibrate",
    "info",
    "check",
    "simulate",
    "estimate",
    "depthmap",
    "report",
    "compare",
    "limits",
)
"""In the order in which help shows them; each is the function `run` of the module of its name."""

app = typer.Typer(
    help="Distance from blur: tables of point spread functions, and estimators with honest error bars.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
for command in COMMANDS:
    app.command(command)(import_module(f"psflut.cli.{command}").run)


def main() -> None:
    """Run, and turn what the caller can mend into one sentence on stderr and exit 2."""
    try:
        code = app(prog_name="psflut", standalone_mode=False)
        sys.stdout.flush()
    except (PsflutError, TyperException, OSError) as error:
        if isinstance(error, BrokenPipeError):  # the reader of our output has left: nothing more is written
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            sys.exit(1)
        console.say(f"psflut: {console.sentence(error)}")
        sys.exit(2)
    except (KeyboardInterrupt, typer.Abort):
        console.say("psflut: interrupted")
        sys.exit(130)
    except MemoryError:
        console.say("psflut: there is not enough memory for this; take smaller images, tables or settings")
        sys.exit(2)
    except Exception as error:
        if "PSFLUT_TRACEBACK" in os.environ:
            raise
        console.say(
            f"psflut: {type(error).__name__} ({console.sentence(error)}), a mistake in psflut; please report it with "
            "what PSFLUT_TRACEBACK=1 makes it print"
        )
        sys.exit(2)
    sys.exit(code if isinstance(code, int) else 0)


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        from psflut import __version__

        print(__version__)
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help())
