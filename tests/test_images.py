"""Reading pictures as linear intensity: every kind of file that is taken, and every kind that is refused."""

import sys

import imageio.v3 as iio
import numpy as np
import pytest
import tifffile

from psflut.errors import PsflutError
from psflut.images import LUMINANCE, crop, linearise, page_shapes, read_image
from psflut.writing import write_tiff


@pytest.fixture
def grey(rng):
    """(20, 30) levels of 8 bits, both ends among them."""
    levels = rng.integers(0, 256, (20, 30), dtype=np.uint8)
    levels[0, :2] = 0, 255
    return levels


def encode(linear):
    """The sRGB encoding, written independently of its inverse in psflut."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0) ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp"])
def test_integers_are_divided_by_their_full_scale(tmp_path, grey, suffix):
    iio.imwrite(tmp_path / f"a{suffix}", grey)
    picture = read_image(tmp_path / f"a{suffix}")
    np.testing.assert_allclose(picture.image, grey / 255.0, rtol=0, atol=1e-15)
    assert (picture.image.dtype, picture.image.min(), picture.image.max()) == (np.float64, 0.0, 1.0)
    assert picture.quantum == pytest.approx(1 / 255)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_sixteen_bits_keep_all_of_them(tmp_path, rng, suffix):
    levels = rng.integers(0, 65536, (20, 30), dtype=np.uint16)
    iio.imwrite(tmp_path / f"a{suffix}", levels)
    picture = read_image(tmp_path / f"a{suffix}")
    np.testing.assert_allclose(picture.image * 65535, levels, rtol=0, atol=1e-9)
    assert picture.quantum == pytest.approx(1 / 65535)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_floats_are_taken_as_they_are_and_never_clipped(tmp_path, rng, dtype):
    values = rng.normal(0.5, 3.0, (20, 30)).astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", values)
    picture = read_image(tmp_path / "a.tif")
    np.testing.assert_array_equal(picture.image, values)
    assert picture.quantum == 0.0


def test_colour_becomes_luminance_and_alpha_is_dropped(tmp_path, rng):
    colour = rng.integers(0, 256, (20, 30, 4), dtype=np.uint8)
    iio.imwrite(tmp_path / "rgba.png", colour)
    iio.imwrite(tmp_path / "rgb.png", colour[..., :3])
    expected = colour[..., :3] / 255.0 @ np.array([0.2125, 0.7154, 0.0721])
    for name in ("rgba.png", "rgb.png"):
        np.testing.assert_allclose(read_image(tmp_path / name).image, expected, atol=1e-12)


def test_luminance_of_grey_is_grey(tmp_path, grey):
    assert sum(LUMINANCE) == pytest.approx(1.0, abs=1e-12)
    iio.imwrite(tmp_path / "colour.png", np.stack([grey] * 3, axis=-1))
    iio.imwrite(tmp_path / "alpha.png", np.stack([grey, np.full_like(grey, 7)], axis=-1))
    for name in ("colour.png", "alpha.png"):
        np.testing.assert_allclose(read_image(tmp_path / name).image, grey / 255.0, atol=1e-12)


def test_planes_of_colour_are_read_as_interleaved_ones(tmp_path, rng):
    colour = rng.random((20, 30, 3)).astype(np.float32)
    planes = np.moveaxis(colour, -1, 0)
    tifffile.imwrite(tmp_path / "p.tif", planes, photometric="rgb", planarconfig="separate")
    tifffile.imwrite(tmp_path / "i.tif", colour, photometric="rgb")
    np.testing.assert_allclose(read_image(tmp_path / "p.tif").image, read_image(tmp_path / "i.tif").image, rtol=1e-12)


def test_srgb_and_gamma_are_inverse_to_their_encodings():
    linear = np.linspace(0.0, 1.0, 1001)
    np.testing.assert_allclose(linearise(encode(linear), srgb=True), linear, atol=2e-6)
    np.testing.assert_allclose(linearise(linear ** (1 / 2.2), 2.2), linear, atol=1e-14)
    np.testing.assert_array_equal(linearise(linear), linear)
    assert linearise(np.array([-0.5]), 2.0) == pytest.approx(-0.25)
    assert linearise(np.array([-0.5]), srgb=True) == -linearise(np.array([0.5]), srgb=True)


def test_an_encoding_is_undone_before_colours_are_mixed(tmp_path, rng):
    colour = rng.integers(0, 256, (20, 30, 3), dtype=np.uint8)
    iio.imwrite(tmp_path / "a.png", colour)
    expected = linearise(colour / 255.0, srgb=True) @ LUMINANCE
    np.testing.assert_allclose(read_image(tmp_path / "a.png", srgb=True).image, expected, atol=1e-12)


@pytest.mark.parametrize("encoding", [{"gamma": 2.2}, {"srgb": True}, {}])
def test_the_quantum_is_the_step_below_full_scale(tmp_path, encoding):
    iio.imwrite(tmp_path / "a.png", np.array([[254, 255]] * 2, dtype=np.uint8))
    picture = read_image(tmp_path / "a.png", **encoding)
    assert picture.quantum == pytest.approx(np.ptp(picture.image), rel=0.01)


@pytest.mark.parametrize(
    "encoding", [{"gamma": g} for g in (0.0, -1.0, np.nan, np.inf)] + [{"gamma": 2.2, "srgb": True}]
)
def test_an_impossible_encoding_is_refused(encoding):
    with pytest.raises(PsflutError, match="gamma"):
        linearise(np.ones(3), **encoding)


def test_writing_and_reading_are_inverse_and_leave_no_date(tmp_path, rng):
    values = rng.normal(size=(20, 30)).astype(np.float32)
    for name in ("a.tif", "b.tiff"):
        write_tiff(tmp_path / name, values, {"distance_m": 1.5})
        np.testing.assert_array_equal(read_image(tmp_path / name).image, values)
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tiff").read_bytes()
    with pytest.raises(PsflutError, match="overwrite"):
        write_tiff(tmp_path / "a.tif", values, {})
    with pytest.raises(PsflutError, match=r"\.tif"):
        write_tiff(tmp_path / "a.png", values, {})


def test_the_window_of_a_patch():
    assert crop((300, 200), None) == (slice(22, 278), slice(0, 200))
    assert crop((300, 200), "10,20,64") == (slice(10, 74), slice(20, 84))
    assert crop((300, 200), "10, 20, 64x32") == (slice(10, 74), slice(20, 52))
    assert crop((300, 200), "236,136,64") == (slice(236, 300), slice(136, 200))


@pytest.mark.parametrize("patch", ["237,136,64", "0,0,0", "0,0", "a,b,c", "-1,0,64", "0,0,64x", "1.5,0,64", ""])
def test_a_patch_that_is_none_is_refused(patch):
    with pytest.raises(PsflutError, match="patch"):
        crop((300, 200), patch)


def damaged(folder):
    """Files that are no picture of intensity, by what is wrong with them."""
    values = np.random.default_rng(0).random((40, 40)).astype(np.float32)
    levels = (values * 255).astype(np.uint8)
    for name, pixels in (("whole.png", levels), ("whole.jpg", levels), ("whole.tif", values)):
        iio.imwrite(folder / name, pixels)
        data = (folder / name).read_bytes()
        for part, length in (("beginning", 20), ("half", len(data) // 2), ("nearly", len(data) - 30)):
            (folder / f"{part}_of_{name}").write_bytes(data[:length])
        (folder / name).unlink()
    (folder / "empty.png").touch()
    (folder / "empty.tif").touch()
    (folder / "garbage.png").write_bytes(np.random.default_rng(1).bytes(3000))
    (folder / "garbage.tif").write_bytes(b"II*\0" + np.random.default_rng(1).bytes(3000))
    (folder / "words.jpg").write_text("not a picture")
    (folder / "folder.png").mkdir()
    hole = values.copy()
    hole[3, 4] = np.nan
    tifffile.imwrite(folder / "hole.tif", hole)
    tifffile.imwrite(folder / "two_pages.tif", np.stack([values] * 2), photometric="minisblack")
    tifffile.imwrite(folder / "two_narrow_pages.tif", np.stack([values[:, :3]] * 2), photometric="minisblack")
    tifffile.imwrite(folder / "bool.tif", values > 0.5)
    tifffile.imwrite(folder / "complex.tif", values.astype(np.complex64))
    iio.imwrite(folder / "bit.png", values > 0.5)
    iio.imwrite(folder / "cmyk.jpg", np.stack([levels] * 4, axis=-1), mode="CMYK")
    iio.imwrite(folder / "moving.gif", np.stack([levels, 255 - levels]))
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture(scope="session")
def damage(tmp_path_factory):
    folder = tmp_path_factory.mktemp("damaged")
    damaged(folder)
    return folder


def test_what_is_no_whole_picture_is_refused_in_one_sentence_that_names_it(damage, capfd):
    names = sorted(path.name for path in damage.iterdir())
    assert len(names) > 20
    for name in [*names, "missing.png"]:
        with pytest.raises(PsflutError) as refused:
            read_image(damage / name)
        sentence = str(refused.value)
        assert str(damage / name) in sentence, name
        assert "\n" not in sentence, name
        assert "plugin" not in sentence, name
        assert ";" in sentence, f"{name}: no remedy in {sentence!r}"
    assert capfd.readouterr() == ("", "")


def test_a_page_of_a_stack_is_read_as_the_file_of_one(tmp_path, rng):
    for name, stack in (
        ("grey", rng.integers(0, 256, (4, 20, 30), dtype=np.uint8)),
        ("colour", rng.integers(0, 65536, (4, 20, 30, 3), dtype=np.uint16)),
        ("float", rng.random((4, 20, 30)).astype(np.float32)),
    ):
        photometric = "rgb" if name == "colour" else "minisblack"
        tifffile.imwrite(tmp_path / "stack.tif", stack, photometric=photometric)
        assert page_shapes(tmp_path / "stack.tif") == ((20, 30),) * 4
        for page, frame in enumerate(stack):
            tifffile.imwrite(tmp_path / "one.tif", frame, photometric=photometric)
            one, same = read_image(tmp_path / "one.tif"), read_image(tmp_path / "one.tif", page=0)
            read = read_image(tmp_path / "stack.tif", page=page)
            np.testing.assert_array_equal(read.image, one.image)
            np.testing.assert_array_equal(same.image, one.image)
            assert read.quantum == one.quantum
        for page in (4, -1):
            with pytest.raises(PsflutError, match=f"4 pages, counted from 0, and no page {page}"):
                read_image(tmp_path / "stack.tif", page=page)


def test_other_files_than_tiff_have_one_page(tmp_path, grey):
    iio.imwrite(tmp_path / "a.png", grey)
    assert page_shapes(tmp_path / "a.png") == ((20, 30),)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png", page=0).image, read_image(tmp_path / "a.png").image)
    with pytest.raises(PsflutError, match="no page 1"):
        read_image(tmp_path / "a.png", page=1)


def test_saturated_is_where_a_channel_is_at_full_scale(tmp_path, grey):
    iio.imwrite(tmp_path / "a.png", grey)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png", gamma=2.2).saturated, grey == 255)
    colour = np.stack([grey, np.full_like(grey, 9), np.full_like(grey, 9)], axis=-1)
    iio.imwrite(tmp_path / "c.png", colour)
    np.testing.assert_array_equal(read_image(tmp_path / "c.png", srgb=True).saturated, grey == 255)
    tifffile.imwrite(tmp_path / "f.tif", np.ones((20, 30), np.float32))
    assert read_image(tmp_path / "f.tif").saturated is None


def test_a_raw_file_names_the_extra_that_reads_it(tmp_path, grey, monkeypatch):
    monkeypatch.setitem(sys.modules, "rawpy", None)
    tifffile.imwrite(tmp_path / "a.dng", grey)  # as a thumbnail would be
    for read in (read_image, page_shapes):
        with pytest.raises(PsflutError, match=r"a\.dng is a RAW file, which needs rawpy; .* psflut\[raw\]"):
            read(tmp_path / "a.dng")


def test_a_raw_file_is_linear_above_its_black_level(tmp_path):
    pytest.importorskip("rawpy", reason="RAW files are an extra")
    signal = np.tile(np.linspace(0.1, 0.6, 96), (64, 1))
    black, white = 256, 4095
    mosaic = np.rint(black + signal * (white - black)).astype(np.uint16)
    mosaic[20:30, 20:30] = white
    identity = (1, 1, 0, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 1, 1)
    digital_negative = [  # the tags that a DNG must have
        (50706, "B", 4, bytes([1, 4, 0, 0]), True),
        (50708, "s", 0, "none", True),
        (33421, "H", 2, (2, 2), True),
        (33422, "B", 4, bytes([0, 1, 1, 2]), True),
        (50714, "H", 1, black, True),
        (50717, "H", 1, white, True),
        (50721, "2i", 9, identity, True),
        (50728, "2I", 3, (1,) * 6, True),
    ]
    tifffile.imwrite(tmp_path / "a.dng", mosaic, photometric="cfa", extratags=digital_negative, metadata=None)
    picture = read_image(tmp_path / "a.dng")
    assert page_shapes(tmp_path / "a.dng") == (picture.image.shape,) == ((64, 96),)
    np.testing.assert_allclose(picture.image[4:16, 4:-4], signal[4:16, 4:-4], atol=3e-4)
    assert np.argwhere(picture.saturated)[[0, -1]].tolist() == [[20, 20], [29, 29]]


def test_the_headers_of_what_is_no_picture_are_refused_as_its_pixels_are(damage):
    for name in ("missing.png", "empty.tif", "garbage.png", "garbage.tif", "words.jpg", "folder.png"):
        with pytest.raises(PsflutError, match=name):
            page_shapes(damage / name)
