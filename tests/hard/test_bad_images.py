"""Pictures that are none, damaged, of other kinds, or larger than they say: refused by every command that reads one."""

import contextlib
import io
import struct
import zlib

import imageio.v3 as iio
import numpy as np
import pytest
import tifffile

from psflut.errors import PsflutError
from psflut.images import page_shapes, read_image

LEVELS = np.random.default_rng(5).integers(0, 250, (64, 64), dtype=np.uint8)


def encoded(suffix, levels=LEVELS):
    buffer = io.BytesIO()
    iio.imwrite(buffer, levels, extension=suffix)
    return buffer.getvalue()


def tiff(values, **settings):
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, values, **settings)
    return buffer.getvalue()


def chunk(name, data):
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png(height, width, data=b"", depth=8, kind=0, head=None):
    """A PNG of whatever header, with the compressed data that are given."""
    head = struct.pack(">IIBBBBB", width, height, depth, kind, 0, 0, 0) if head is None else head
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b"")


def tiff_claiming(height, width, compression=1, order="<"):
    """A TIFF of one grey page, 8 bits, whose header claims more than there is."""
    tags = [(256, width), (257, height), (258, 8), (259, compression), (262, 1), (273, 200), (277, 1), (278, height)]
    tags += [(279, 800)]
    body = struct.pack(f"{order}H", len(tags))
    for tag, value in tags:
        body += struct.pack(f"{order}HHII", tag, 4, 1, value)
    start = b"II*\0" if order == "<" else b"MM\0*"
    head = start + struct.pack(f"{order}I", 8) + body + struct.pack(f"{order}I", 0)
    return head.ljust(1000, b"\7")


def looped():
    """Page after page, and after the last the first again."""
    found = bytearray(tiff(LEVELS))
    count = struct.unpack_from("<H", found, struct.unpack_from("<I", found, 4)[0])[0]
    struct.pack_into("<I", found, struct.unpack_from("<I", found, 4)[0] + 2 + 12 * count, 8)
    return bytes(found)


def npy(values, shape=None):
    buffer = io.BytesIO()
    np.save(buffer, values)
    found = buffer.getvalue()
    return found if shape is None else found.replace(b"(64, 64)", shape)


def flipped(data, at):
    found = bytearray(data)
    found[at] ^= 0x40
    return bytes(found)


FLOATS = (LEVELS / 250.0).astype(np.float32)
HUGE = 100_000


def spotted(value):
    found = FLOATS.copy()
    found[3, 4] = value
    return found


PICTURES = {
    "empty.png": b"",
    "empty.tif": b"",
    "empty.jpg": b"",
    "text.png": b"This is no picture.\n",
    "text.tif": b"This is no picture.\n",
    "zeros.png": bytes(4096),
    "nonsense.png": np.random.default_rng(1).bytes(5000),
    "nonsense.tif": b"II*\0" + np.random.default_rng(2).bytes(5000),
    "nonsense.jpg": b"\xff\xd8\xff\xe0" + np.random.default_rng(3).bytes(5000),
    "page.html": b"<html><body>404 not found</body></html>",
    "paper.pdf": b"%PDF-1.4\n1 0 obj\n<<>>\nendobj\n",
    "half.png": encoded(".png")[:2000],
    "nearly.png": encoded(".png")[:-60],
    "head.png": encoded(".png")[:20],
    "half.jpg": encoded(".jpg")[: len(encoded(".jpg")) // 2],
    "half.tif": tiff(LEVELS)[:2000],
    "half-packed.tif": tiff(LEVELS, compression="zlib")[:2000],
    "head.tif": tiff(LEVELS)[:6],
    "half.bmp": encoded(".bmp")[:2000],
    "half.gif": encoded(".gif")[:1000],
    "flipped-head.png": flipped(encoded(".png"), 20),
    "flipped-size.png": flipped(encoded(".png"), 18),
    "flipped-data.png": flipped(encoded(".png"), 2000),
    "flipped-packed.tif": flipped(tiff(LEVELS, compression="zlib"), 2500),
    "not-finite.tif": tiff(spotted(np.nan)),
    "infinite.tif": tiff(spotted(np.inf)),
    "negative.tif": tiff(spotted(-50.0)),
    "complex.tif": tiff(FLOATS.astype(np.complex64)),
    "bool.tif": tiff(LEVELS > 100),
    "bool.png": png(8, 8, bytes(16), depth=1),
    "channels-5.tif": tiff(np.zeros((64, 64, 5), np.uint8), photometric="minisblack", planarconfig="contig"),
    "volume.tif": tiff(np.zeros((4, 64, 64), np.uint8), photometric="minisblack", volumetric=True),
    "pages.tif": tiff(np.zeros((3, 64, 64), np.uint8), photometric="minisblack"),
    "looped.tif": looped(),
    "line.tif": tiff(np.zeros((1, 64), np.uint8) + 7),
    "dot.png": encoded(".png", LEVELS[:1, :1]),
    "small.png": encoded(".png", LEVELS[:5, :5]),
    "none.png": png(0, 0),
    "narrow.png": png(64, 0),
    "huge.png": png(HUGE, HUGE, bytes(500)),
    "huger.png": png(2**31 - 1, 2**31 - 1, bytes(500)),
    "large.png": png(20_000, 20_000, bytes(500)),
    "depth.png": png(8, 8, bytes(100), depth=7),
    "colours.png": png(8, 8, bytes(100), kind=9),
    "header.png": png(8, 8, head=b"abc"),
    "huge.tif": tiff_claiming(HUGE, HUGE),
    "huge-packed.tif": tiff_claiming(HUGE, HUGE, compression=8),
    "huge-be.tif": tiff_claiming(HUGE, HUGE, order=">"),
    "large.tif": tiff_claiming(16_000, 16_000),
    "long.tif": tiff_claiming(2**32 - 1, 1),
    "none.tif": tiff_claiming(0, 0),
    "unknown-packing.tif": tiff_claiming(64, 64, compression=60_000),
    "array.npy": npy(FLOATS),
    "array-huge.npy": npy(FLOATS, b"(100000, 100000)"),
    "array-pickled.npy": b"\x93NUMPY\x01\x00\x10\x00{'descr': '|O'}",
    "cmyk.tif": tiff(np.zeros((64, 64, 4), np.uint8), photometric="separated"),
    "palette.tif": tiff(LEVELS, photometric="palette", colormap=np.zeros((3, 256), np.uint16)),
    "frame.dng": b"II*\0" + bytes(100),
    "frame.cr2": b"",
    "frame.nef": b"nonsense" * 100,
}
UNREADABLE = [
    name
    for name in PICTURES
    if name not in ("negative.tif", "small.png", "dot.png", "line.tif", "bool.png", "pages.tif")
]
COMMANDS = (
    ["estimate", "P", "--table", "lab16mm", "--noise", "0.01"],
    ["simulate", "P", "--camera", "camera.toml", "--distance", "1.2 m", "-o", "o.tif"],
    ["report", "P", "--table", "lab16mm", "--noise", "0.01", "-o", "r.html"],
    ["estimate", "image.tif", "--table", "lab16mm", "--method", "golden_section", "--scene", "P"],
    ["estimate", "image.tif", "--table", "lab16mm", "--second", "P", "--second-table", "lab16mm"],
    ["calibrate", "captures.csv", "--target", "point", "--pixel-pitch", "6 um", "--dark", "P", "-o", "n.zarr"],
    ["calibrate", "captures.csv", "--target", "pattern", "--reference", "P", "--pixel-pitch", "6 um", "-o", "n.zarr"],
    ["calibrate", "spoilt.csv", "--target", "point", "--pixel-pitch", "6 um", "-o", "n.zarr"],
    ["compare", "--table", "lab16mm", "--images", "pictures", "-o", "out"],
)


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_that_is_none_is_refused(refused, desk, name):
    (desk / name).write_bytes(PICTURES[name])
    (desk / "spoilt.csv").write_text(f"file,distance_m\n{name},1.1\n1.tif,1.6\n2.tif,2.9\n")
    (desk / "pictures").mkdir()
    (desk / "pictures" / f"{name.partition('.')[0]}.png").write_bytes(PICTURES[name])
    number = list(PICTURES).index(name)
    words = COMMANDS[number % len(COMMANDS)] if name in UNREADABLE else COMMANDS[2 * (number % 2)]
    assert name.partition(".")[0] in refused(*(name if word == "P" else word for word in words))
    if name in UNREADABLE:
        with pytest.raises(PsflutError, match=name):
            read_image(desk / name)


@pytest.mark.parametrize("name", ["huge.png", "huger.png", "huge.tif", "huge-packed.tif", "huge-be.tif", "long.tif"])
def test_a_small_file_that_claims_to_be_huge_takes_no_memory(desk, name, little_memory):
    (desk / name).write_bytes(PICTURES[name])
    assert len(PICTURES[name]) <= 1024
    with little_memory():
        with pytest.raises(PsflutError, match=name) as refused:
            read_image(desk / name)
        with contextlib.suppress(PsflutError):
            page_shapes(desk / name)  # which asks for no pixels
    assert not isinstance(refused.value.__cause__, MemoryError)


def test_the_control_an_array_of_a_gigabyte_does(little_memory):
    with little_memory(), pytest.raises(MemoryError):
        np.empty(1_000_000_000, np.uint8)


@pytest.mark.parametrize("level", [0.0, 0.5, 0.99])
@pytest.mark.parametrize("method", ["wiener", "golden_section:iterations=2", "blind_rl"])
def test_a_constant_picture_is_flat(desk, run, capfd, level, method):
    tifffile.imwrite(desk / "constant.tif", np.full((64, 64), level, np.float32))
    assert run("estimate", desk / "constant.tif", "--table", "lab16mm", "--noise", "0.01", "--method", method) == 0
    assert "flat" in capfd.readouterr().out


@pytest.mark.parametrize(
    "values",
    [LEVELS, LEVELS.astype(np.uint16) * 257, np.stack([LEVELS] * 3, -1), np.stack([LEVELS] * 4, -1), FLOATS],
    ids=["8 bits", "16 bits", "colour", "colour and alpha", "floats"],
)
def test_the_control_whole_pictures_are_read(desk, values):
    path = desk / ("whole.tif" if values.dtype == np.float32 else "whole.png")
    (tifffile.imwrite if path.suffix == ".tif" else iio.imwrite)(path, values)
    assert read_image(path).image.shape == (64, 64)
    assert page_shapes(path) == ((64, 64),)
