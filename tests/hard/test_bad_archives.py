"""Broken tables in zip archives: each refused by `read_table`, and by commands, in a sentence that names it."""

import zipfile

import numpy as np
import pytest
from samples import sampled
from spoilers import command

from psflut import store
from psflut.errors import PsflutError


def entries(change):
    """Write the archive anew with another list of (name, data, compression)."""

    def spoil(path):
        with zipfile.ZipFile(path) as archive:
            found = [(each.filename, archive.read(each), zipfile.ZIP_STORED) for each in archive.infolist()]
        with zipfile.ZipFile(path, "w") as archive:
            for name, data, kind in change(found):
                archive.writestr(name, data, kind)

    return spoil


def linked(path):
    """The first plane's entry as a link, as Unix packers write it."""
    with zipfile.ZipFile(path) as archive:
        found = [(each.filename, archive.read(each)) for each in archive.infolist()]
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in found:
            entry = zipfile.ZipInfo(name)
            entry.external_attr = (0o120777 if name == "psf/c/0/0/0" else 0o100644) << 16
            archive.writestr(entry, data)


def edit(change):
    return lambda path: path.write_bytes(change(path.read_bytes()))


ARCHIVES = {
    "nothing": lambda p: p.unlink(),
    "an empty file": edit(lambda b: b""),
    "text": edit(lambda b: b"psf"),
    "a folder": lambda p: (p.unlink(), p.mkdir()),
    "an archive of nothing": entries(lambda e: []),
    "an archive of something else": entries(lambda e: [("readme.txt", b"hello", 0)]),
    "one folder too deep": entries(lambda e: [("t.zarr/" + n, d, k) for n, d, k in e]),
    "half": edit(lambda b: b[: len(b) // 2]),
    "its end cut": edit(lambda b: b[:-30]),
    "its beginning cut": edit(lambda b: b[64:]),
    "the middle zeroed": edit(lambda b: b[:3000] + bytes(500) + b[3500:]),
    "a name that climbs out": entries(lambda e: [*e, ("../../evil", b"x", 0)]),
    "an absolute name": entries(lambda e: [*e, ("/tmp/evil", b"x", 0)]),
    "a name with backslashes": entries(lambda e: [*e, ("..\\evil", b"x", 0)]),
    "a drive's name": entries(lambda e: [*e, ("C:/evil", b"x", 0)]),
    "a link": linked,
    "a bomb": entries(lambda e: [*e[:-1], ("zarr.json", b" " * 50_000_000, zipfile.ZIP_DEFLATED)]),
    "deflated": entries(lambda e: [(n, d, zipfile.ZIP_DEFLATED) for n, d, _ in e]),
    "encrypted": edit(
        lambda b: b.replace(b"PK\3\4\x14\0\0\0", b"PK\3\4\x14\0\1\0").replace(
            b"PK\1\2\x14\3\x14\0\0\0", b"PK\1\2\x14\3\x14\0\1\0"
        )
    ),
    "a plane missing": entries(lambda e: [each for each in e if each[0] != "psf/c/1/0/0"]),
}


@pytest.mark.parametrize("damage", ARCHIVES)
def test_a_broken_archive_is_refused(desk, damage):
    ARCHIVES[damage](desk / "t.zarr.zip")
    with pytest.raises(PsflutError, match=r"t\.zarr\.zip"):
        store.read_table(desk / "t.zarr.zip")


@pytest.mark.parametrize("damage", sampled(ARCHIVES))
def test_commands_refuse_a_broken_archive(refused, desk, damage):
    ARCHIVES[damage](desk / "t.zarr.zip")
    assert "t.zarr.zip" in refused(*command("t.zarr.zip", list(ARCHIVES).index(damage)))


def test_the_control_whole_archives_are_read(desk, small):
    entries(lambda found: found)(desk / "t.zarr.zip")
    np.testing.assert_allclose(store.read_table(desk / "t.zarr.zip").psf, small.psf, atol=1e-7)
