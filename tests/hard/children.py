"""Commands in processes that can be killed: forked from a server that has imported everything, they start at once."""

import contextlib
import multiprocessing
import os
import signal
import sys
import time

CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(
    ["psflut.cli", "psflut.store", "psflut.compare", "psflut.estimators.wiener", "calib.recipe", "calib.calibrate"]
)


def command(words, folder, log):
    """In the child: a command in a folder, what it says in a file."""
    os.chdir(folder)
    with open(log, "w") as file, contextlib.redirect_stderr(file), contextlib.redirect_stdout(file):
        from psflut import cli, gallery

        gallery.draw = lambda *_: None  # figures take seconds and have nothing to lose
        sys.argv = ["psflut", *map(str, words)]
        cli.main()


def start(target, *words):
    """A process of that function, begun."""
    process = CONTEXT.Process(target=target, args=words)
    process.start()
    return process


def killed_after(seconds, target, *words):
    """Run a function in a process and kill it (-9) after so long; whether it had not ended by then."""
    process = start(target, *words)
    process.join(seconds)
    alive = process.is_alive()
    if alive:
        os.kill(process.pid, signal.SIGKILL)
    process.join()
    return alive


def duration(target, *words):
    """Seconds that a function takes to its end."""
    begun = time.perf_counter()
    process = start(target, *words)
    process.join()
    assert process.exitcode == 0
    return time.perf_counter() - begun
