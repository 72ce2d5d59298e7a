"""Who does the work of a comparison: this process, or one on every core. (A Dask cluster: `psflut.cluster`.)"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool

from psflut.errors import PsflutError
from psflut.trial import Bench, Record, Unit, trial

_bench: Bench
"""In a worker: what its units need."""


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def local(bench: Bench, units: Sequence[Unit], count: int) -> Iterator[list[Record]]:
    """The records of every unit, in the order in which they come, by `count` processes of one thread each.

    Raises
    ------
    PsflutError
        Where a unit raised it, or a process died.
    """
    if count == 1 or len(units) < 2:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1):  # threads would sum in another order
            yield from (trial(bench, unit) for unit in units)
        return
    others = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(count, len(units)), context, _begin, (bench,))
    try:
        for done in as_completed([pool.submit(_work, unit) for unit in units]):
            yield done.result()
    except BrokenProcessPool as error:
        raise PsflutError(
            "a worker process died, perhaps for want of memory; what is finished is kept: go on with fewer --workers"
        ) from error
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()


def _begin(bench: Bench) -> None:
    """In a new worker: one thread, deaf to Ctrl-C, which is for the parent, and gone when that is."""
    from threadpoolctl import threadpool_limits

    global _bench
    _bench = bench
    threadpool_limits(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work(unit: Unit) -> list[Record]:
    return trial(_bench, unit)
