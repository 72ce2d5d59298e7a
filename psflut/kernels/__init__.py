"""Loops that are compiled, and kept compiled: a numpy call costs a microsecond, and these do a few numbers each.

Alone of psflut's modules those in this folder import numba, and are themselves imported where they are called: loading
it takes 0.3 s.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])

OPTIONS = {
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"reassoc", "contract", "arcp", "nsz"},
    "forceinline": True,
}
"""Sums may be taken in any order. What a compiled function calls becomes part of it: else it would be optimised once on
its own and once more in what is kept of its caller, and the first run would differ from the next in the last bits."""


def inlined(function: Function) -> Function:
    """Compiled as part of the function that calls it, in one place: a third of the time that compiling each takes."""
    return njit(inline="always", **OPTIONS)(function)  # type: ignore[no-any-return]


def compiled(function: Function) -> Function:
    """Compiled when first called, and kept: beside its file, else in the user's cache, else for this process alone.

    What is kept holds the code of all that the function calls, but numba asks whether
    the function's own file has changed; here what is kept is stale where any file of the folder has.
    """
    try:
        made = njit(cache=True, **OPTIONS)(function)
    except RuntimeError:
        return njit(**OPTIONS)(function)  # type: ignore[no-any-return]
    folder = Path(function.__code__.co_filename).parent
    files = [each.stat() for each in sorted(folder.glob("*.py"))]
    made._cache._cache_file._source_stamp = [(each.st_mtime, each.st_size) for each in files]
    return made  # type: ignore[no-any-return]
