"""The journal of a long run: one JSON object a line, written as soon as it is known, so that a kill costs little."""

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Self

from psflut.errors import PsflutError
from psflut.trial import Record

FORMAT = "psflut-compare 1"


class Journal:
    """Records of a run in a file, and of those that were there before.

    The first line holds the settings of the run, which count once there is a record. A last line that was torn by a
    kill or a full disk is dropped.
    Use it as a context.

    Parameters
    ----------
    path : Path
        Of the file, which is made where there is none.
    settings : mapping
        Plain JSON; whoever goes on must have the same.

    Raises
    ------
    PsflutError
        If the file is no journal, or of other settings; if it cannot be written.
    """

    def __init__(self, path: Path, settings: Mapping[str, Any]) -> None:
        self.path = path
        head = {"format": FORMAT, "settings": json.loads(json.dumps(settings))}
        try:
            lines = _whole_lines(path)
            self.records = _records(path, lines, head) if lines else []
            self._file = path.open("r+b" if self.records else "wb")
            if self.records:
                self._file.truncate(sum(map(len, lines)))
                self._file.seek(0, os.SEEK_END)
            else:  # nothing binds whoever begins
                self._write([head])
        except OSError as error:
            raise PsflutError(
                f"cannot write {path}: {error.strerror or error}; choose another folder with -o"
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
        if not self.records:  # refused before its first result: nothing is left behind
            self.path.unlink(missing_ok=True)

    def append(self, records: list[Record]) -> None:
        """Keep these too, on the disk before this returns."""
        try:
            self._write(record._asdict() for record in records)
        except OSError as error:
            raise PsflutError(f"cannot write {self.path}: {error.strerror or error}; make room and go on") from error
        self.records += records

    def _write(self, objects: Iterable[Mapping[str, Any]]) -> None:
        self._file.write(b"".join(json.dumps(each).encode() + b"\n" for each in objects))
        self._file.flush()
        os.fsync(self._file.fileno())


def _whole_lines(path: Path) -> list[bytes]:
    if not path.exists():
        return []
    lines = path.read_bytes().splitlines(keepends=True)
    return lines if not lines or lines[-1].endswith(b"\n") else lines[:-1]


def _records(path: Path, lines: list[bytes], head: Mapping[str, Any]) -> list[Record]:
    try:
        found, *rows = (json.loads(line) for line in lines)
        if found["format"] != FORMAT:
            raise ValueError(found["format"])
        records = [Record(**row) for row in rows]
    except (ValueError, TypeError, KeyError) as error:
        raise PsflutError(f"{path} is no journal of this psflut ({error}); choose another folder with -o") from error
    old, new = found["settings"], head["settings"]
    for name in sorted(old.keys() | new.keys()):
        if records and old.get(name) != new.get(name):
            raise PsflutError(
                f"{path.parent} holds a comparison with other settings ({name} {old.get(name)}, not {new.get(name)}); "
                "choose another folder with -o"
            )
    return records
