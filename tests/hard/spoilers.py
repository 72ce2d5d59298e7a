"""What spoils a table on the disc: each is a function of the table's path, or makes one."""

import json
import os
import shutil

import numpy as np
import pytest

from psflut import layout, store


def meta(change, array=""):
    """Change the zarr.json of the group or of an array."""

    def spoil(path):
        file = path / array / "zarr.json"
        found = json.loads(file.read_text())
        change(found)
        file.write_text(json.dumps(found))

    return spoil


def put(name, data):
    """Replace a file, which may be absent, by these bytes."""

    def spoil(path):
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(data)

    return spoil


def attributes(**changes):
    """Change attributes and mend the checksum: as a wrong program would write it."""

    def spoil(path):
        def change(found):
            attrs = found["attributes"]
            attrs.update(changes)
            rest = {k: v for k, v in attrs.items() if k not in ("sha256", "complete")}
            attrs["sha256"]["attributes"] = layout.sums({}, rest)["attributes"]

        meta(change)(path)

    return spoil


def arrays(**changes):
    """Write the table with other arrays, of right checksums: each value is a function of the whole ones."""

    def spoil(path):
        table = store.read_table(path)
        whole = layout.arrays_of(table)
        spoilt = {name: np.asarray(change(whole[name].copy())) for name, change in changes.items()}
        shutil.rmtree(path)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(layout, "arrays_of", lambda _: whole | spoilt)
            store._write_group(table, path)

    return spoil


def at(index, value):
    def change(array):
        array[index] = value
        return array

    return change


def truncate(name, keep):
    return lambda path: (path / name).write_bytes((path / name).read_bytes()[:keep])


def remove(name):
    return lambda path: shutil.rmtree(path / name) if (path / name).is_dir() else (path / name).unlink()


def link(name, to):
    def spoil(path):
        remove(name)(path)
        (path / name).symlink_to(to)

    return spoil


def moved_and_linked(path):
    """The chunk itself, whole, but outside the table: it may change at any time."""
    shutil.move(path / "psf/c/0/0/0", path.parent / "elsewhere")
    (path / "psf/c/0/0/0").symlink_to(path.parent / "elsewhere")


def fifo(path):
    (path / "psf/c/0/0/0").unlink()
    os.mkfifo(path / "psf/c/0/0/0")


def become(make):
    return lambda path: (shutil.rmtree(path), make(path))


def rows(array):
    return array[:, :5]


def zarr_array(path):
    import zarr

    shutil.rmtree(path)
    zarr.create_array(path, shape=(3,), dtype="f4")


COMMANDS = (
    ["info", "T"],
    ["estimate", "image.tif", "--table", "T", "--noise", "0.01"],
    ["simulate", "image.png", "--table", "T", "--distance", "1.2 m", "-o", "o.tif"],
    ["limits", "--table", "T", "--json"],
    ["check", "T", "captures.csv", "--target", "point"],
    ["compare", "--table", "T", "--method", "wiener", "--runs", "1", "-o", "out"],
    ["report", "image.tif", "--table", "T", "-o", "r.html"],
    ["depthmap", "image.tif", "--table", "T", "--noise", "0.01", "-o", "m.zarr"],
)
"""Commands that read a table."""


def command(name, number):
    """One of them, of that table."""
    return [name if word == "T" else word for word in COMMANDS[number % len(COMMANDS)]]
