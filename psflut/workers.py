"""Who does work in pieces: this process, or one on every core. (A Dask cluster: `psflut.cluster`.)"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

from psflut.errors import PsflutError
from psflut.trial import trial

_shared: Any
_work: Callable[[Any, Any], Any]
"""In a worker: what its units need, and what is done with each."""


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def local(shared: Any, units: Sequence[Any], count: int, work: Callable[[Any, Any], Any] = trial) -> Iterator[Any]:
    """What `work` makes of every unit, in the order in which they come, by `count` processes of one thread each.

    Raises
    ------
    PsflutError
        Where a unit raised it, or a process died.
    """
    if count == 1 or len(units) < 2:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1):  # threads would sum in another order
            yield from (work(shared, unit) for unit in units)
        return
    others = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(count, len(units)), context, _begin, (shared, work))
    try:
        with _deaf():
            futures = [pool.submit(_one, unit) for unit in units]
        for done in as_completed(futures):
            yield done.result()
    except BrokenProcessPool as error:
        raise PsflutError(
            "a worker process died, perhaps for want of memory; what is finished is kept: go on with fewer --workers"
        ) from error
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()


@contextmanager
def _deaf() -> Iterator[None]:
    """Processes that are started meanwhile never hear Ctrl-C, which is for their parent: it hears it afterwards."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows: they do until `_begin`
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(shared: Any, work: Callable[[Any, Any], Any]) -> None:
    """In a new worker: one thread, deaf to Ctrl-C, which is for the parent, and gone when that is."""
    from threadpoolctl import threadpool_limits

    global _shared, _work
    _shared, _work = shared, work
    threadpool_limits(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _one(unit: Any) -> Any:
    return _work(_shared, unit)
