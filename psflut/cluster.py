"""Work in pieces on a Dask cluster that is running already: of a comparison, of a map of distances."""

import logging
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any

from psflut import __version__
from psflut.errors import PsflutError
from psflut.trial import trial

PATIENCE = 5.0
"""Seconds in which a scheduler must answer, and have a worker."""


def cluster(shared: Any, units: Sequence[Any], address: str, work: Callable[[Any, Any], Any] = trial) -> Iterator[Any]:
    """What `work` makes of every unit, in the order in which they come.

    Parameters
    ----------
    shared : object
        What all units need, such as a `Bench`: sent to every worker once.
    units : sequence
    address : str
        Of the scheduler, such as ``tcp://192.168.0.5:8786``.
    work : callable
        From `shared` and a unit to what is yielded; a function of a module.

    Raises
    ------
    PsflutError
        If dask is not installed, no scheduler or worker answers, the workers have another psflut, or the cluster goes
        away; where a unit raised it.
    """
    client = _client(address)
    from distributed import as_completed

    with client:
        sent = client.scatter(shared, broadcast=True, hash=False)
        futures = [client.submit(_work, work, sent, unit, pure=False) for unit in units]
        try:
            for done in as_completed(futures, loop=client.loop):
                yield done.result()
        except PsflutError:
            raise
        except Exception as error:  # of dask, tornado and asyncio, which share no base class
            reason = str(error) or type(error).__name__
            raise PsflutError(f"the cluster at {address} failed ({reason}); what is finished is kept: go on") from error
        finally:
            client.cancel(futures)


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise PsflutError("--scheduler needs dask; install it with: pip install psflut[lab]") from error
    for handler in logging.getLogger("distributed").handlers:
        handler.setLevel(logging.CRITICAL)  # what it complains of comes as our one sentence
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise PsflutError(
            f"no Dask scheduler answers at {address} within {PATIENCE:g} s; start one with 'dask scheduler' and "
            "'dask worker ADDRESS', or leave --scheduler out"
        ) from error
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
        found = set(client.run(version).values())
    except Exception as error:
        client.close()
        raise PsflutError(
            f"the cluster at {address} has no worker that can import psflut ({type(error).__name__}); start one with "
            f"'dask worker {address}' where psflut {__version__} is installed"
        ) from error
    if found != {__version__}:
        client.close()
        raise PsflutError(f"the workers at {address} have psflut {', '.join(found)}, not {__version__}; install one")
    return client


def version() -> str:
    """Of psflut, where it is called."""
    return __version__


@cache
def _one_thread() -> None:
    """Threads would sum in another order: the same numbers come from everywhere."""
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)


def _work(work: Callable[[Any, Any], Any], shared: Any, unit: Any) -> Any:
    _one_thread()
    return work(shared, unit)
