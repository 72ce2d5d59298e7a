"""The command line: options in, calls, words out, one command a file. No science here.

Results go to stdout (``--json``: one JSON object a line and nothing else), messages and progress to stderr.
Exit 0: done; 2: refused with one sentence; 130: interrupted.
"""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
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
    with _interruptions() as heard:
        try:
            code = app(prog_name="psflut", standalone_mode=False)
            if sys.stdout is not None:  # closed by whoever called
                sys.stdout.flush()
        except (Exception, KeyboardInterrupt) as error:
            code = 130 if heard or isinstance(error, KeyboardInterrupt | typer.Abort) else _failed(error)
    if code == 130:
        console.say("psflut: interrupted")
    sys.exit(code if isinstance(code, int) else 0)


def _failed(error: BaseException) -> int:
    """Say what went wrong: the exit code."""
    if isinstance(error, BrokenPipeError):  # the reader of our output has left: nothing more is written
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    if isinstance(error, PsflutError | TyperException | OSError):
        console.say(f"psflut: {console.sentence(error)}")
    elif isinstance(error, MemoryError):
        console.say("psflut: there is not enough memory for this; take smaller images, tables or settings")
    elif "PSFLUT_TRACEBACK" in os.environ:
        raise error
    else:
        console.say(
            f"psflut: {type(error).__name__} ({console.sentence(error)}), a mistake in psflut; please report it with "
            "what PSFLUT_TRACEBACK=1 makes it print"
        )
    return 2


@contextmanager
def _interruptions() -> Iterator[list[int]]:
    """Every Ctrl-C so far: one that meets the import of compiled code comes out of it as some other error."""
    heard: list[int] = []

    def hear(number: int, _: object) -> None:
        heard.append(number)
        raise KeyboardInterrupt

    usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    ours = usual and threading.current_thread() is threading.main_thread()
    if ours:
        signal.signal(signal.SIGINT, hear)
    try:
        yield heard
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)


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
