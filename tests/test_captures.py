"""Real captures: every manifest that is taken or refused, and frames as linear intensity."""

import imageio.v3 as iio
import numpy as np
import pytest
import tifffile

from calib.captures import read_dark, shots
from calib.manifest import read_manifest
from psflut.errors import PsflutError


@pytest.fixture
def folder(tmp_path):
    """Frames of (20, 30) pixels: a.png to d.png, and a stack of five pages; one frame of another shape."""
    levels = np.random.default_rng(3).integers(20, 200, (9, 20, 30), dtype=np.uint8)
    for name, frame in zip("abcd", levels, strict=False):
        iio.imwrite(tmp_path / f"{name}.png", frame)
    tifffile.imwrite(tmp_path / "stack.tif", levels[4:], photometric="minisblack")
    iio.imwrite(tmp_path / "small.png", levels[0, :10])
    (tmp_path / "below").mkdir()
    iio.imwrite(tmp_path / "below" / "e.png", levels[0])
    return tmp_path


def manifest_of(folder, text, **options):
    (folder / "captures.csv").write_text(text)
    return read_manifest(folder / "captures.csv", **options)


def test_a_manifest_gives_rows_in_metres(folder):
    manifest = manifest_of(
        folder, "file,stage_mm,x,y\na.png,-2,12.5,7\nbelow/e.png,-2,,\n\n b.png , 0.5 ,29,19\r\nc.png,3,0,0\n"
    )
    assert (manifest.kind, manifest.shape) == ("stage", (20, 30))
    assert manifest.positions == (-0.002, 0.0005, 0.003)
    assert [row.centre for row in manifest.rows] == [(7.0, 12.5), None, (19.0, 29.0), (0.0, 0.0)]
    assert [row.name for row in manifest.rows] == ["a.png", "e.png", "b.png", "c.png"]


@pytest.mark.parametrize(
    ("column", "kind", "metres"),
    [
        ("distance_m", "distance", 2.0),
        ("distance_mm", "distance", 2e-3),
        ("stage_m", "stage", 2.0),
        ("stage_mm", "stage", 2e-3),
        ("stage_um", "stage", 2e-6),
    ],
)
def test_every_unit_of_position(folder, column, kind, metres):
    manifest = manifest_of(folder, f"file,{column}\na.png,2\n")
    assert (manifest.kind, manifest.positions) == (kind, pytest.approx((metres,), rel=1e-15))


def test_a_spreadsheets_own_marks_do_no_harm(folder):
    (folder / "captures.csv").write_bytes(b'\xef\xbb\xbffile,stage_um\r\n"a.png",1\r\nb.png,2\r\n')
    assert len(read_manifest(folder / "captures.csv").rows) == 2


def test_positions_may_fall_along_the_file_and_come_back_ascending(folder):
    manifest = manifest_of(folder, "file,distance_m\na.png,3\nb.png,2\nc.png,2\nd.png,1\n", least_positions=3)
    assert manifest.positions == (1.0, 2.0, 3.0)
    assert [shot.name for shot in shots(manifest, 2.0)] == ["b.png", "c.png"]


REFUSED = {
    "": "lists no frames",
    "file,stage_mm\n": "lists no frames",
    "file,stage_mm,colour\na.png,1,red\n": "row 1: unknown column 'colour'",
    "file;stage_mm\na.png;1\n": "row 1: unknown column 'file;stage_mm'",
    "stage_mm\n1\n": "row 1: the column file",
    "file,x,y\na.png,1,1\n": "row 1: .* got none",
    "file,stage_mm,distance_m\na.png,1,1\n": "row 1: .* got stage_mm and distance_m",
    "file,stage_mm,stage_mm\na.png,1,1\n": "row 1: .* twice",
    "file,stage_mm,x\na.png,1,1\n": "row 1: .* both x and y",
    "file,stage_mm\na.png,1,2\n": "row 2: it has 3 cells, expected 2",
    "file,stage_mm\na.png\n": "row 2: it has 1 cells, expected 2",
    "file,stage_mm\na.png,1\n\nb.png,far\n": "row 4: stage_mm must be a number, got 'far'",
    "file,stage_mm\na.png,\n": "row 2: stage_mm must be a number, got ''",
    "file,stage_mm\na.png,nan\n": "row 2: stage_mm must be a number, got 'nan'",
    "file,stage_mm\na.png,1e999\n": "row 2: stage_mm must be a number",
    "file,distance_m\na.png,0\n": "row 2: a distance must be positive, got '0'",
    "file,distance_mm\na.png,-1\n": "row 2: a distance must be positive, got '-1'",
    "file,stage_mm\na.png,1\na.png,2\n": "row 3: a.png is listed twice",
    "file,stage_mm\na.png,1\n./a.png,2\n": "row 3: a.png is listed twice",
    "file,page,stage_mm\na.png,,1\na.png,0,2\n": "row 3: a.png page 0 is listed twice",
    "file,x,y,stage_mm\na.png,3,4,1\na.png,3,4,1\n": "row 3: a.png is listed twice",
    "file,x,y,stage_mm\na.png,3,4,1\na.png,9,4,2\n": "row 3: a.png is listed twice",
    "file,x,y,stage_mm\na.png,3,4,1\na.png,,,1\n": "row 3: a.png is listed twice",
    "file,stage_mm\nz.png,1\n": "row 2: no file 'z.png'",
    "file,stage_mm\nbelow,1\n": "row 2: no file 'below'",
    "file,stage_mm\n,1\n": "row 2: file is a name",
    "file,stage_mm\nbelow/../a.png,1\n": "row 2: file is a name",
    "file,stage_mm\n/etc/hostname,1\n": "row 2: file is a name",
    "file,stage_mm\nC:\\a.png,1\n": "row 2: file is a name",
    "file,stage_mm\n..\\a.png,1\n": "row 2: file is a name",
    f"file,stage_mm\n{'a' * 5000}.png,1\n": "row 2: no file",
    "file,page,stage_mm\nstack.tif,5,1\n": "row 2: stack.tif has pages 0 to 4, got page 5",
    "file,page,stage_mm\na.png,1,1\n": "row 2: a.png has pages 0 to 0, got page 1",
    "file,page,stage_mm\nstack.tif,-1,1\n": "row 2: a page is a whole number",
    "file,page,stage_mm\nstack.tif,1.0,1\n": "row 2: a page is a whole number",
    "file,stage_mm\nstack.tif,1\n": "row 2: stack.tif has 5 pages; say which",
    "file,stage_mm\na.png,1\nsmall.png,2\n": "row 3: small.png has 10 x 30 pixels, expected 20 x 30",
    "file,stage_mm,x,y\na.png,1,30,0\n": "row 2: the centre x = 30, y = 0 lies outside",
    "file,stage_mm,x,y\na.png,1,5,\n": "row 2: y must be a number",
    "file,stage_mm\na.png,1\nb.png,2\nc.png,1.5\n": "row 4: its position turns back",
    "file,stage_mm\na.png,2\nb.png,2\nc.png,1\nd.png,2\n": "row 5: its position turns back",
    "file,stage_mm\ncaptures.csv,1\n": "row 2: .*cannot read",
    'file,stage_mm\n"a.png,1\n': "no readable CSV",
}


@pytest.mark.parametrize(("text", "sentence"), REFUSED.items(), ids=[str(n) for n in range(len(REFUSED))])
def test_a_manifest_that_is_wrong_is_refused_by_file_and_row(folder, text, sentence):
    with pytest.raises(PsflutError, match=sentence) as refused:
        manifest_of(folder, text)
    assert str(folder / "captures.csv") in str(refused.value)
    assert "\n" not in str(refused.value)


def test_what_is_no_text_or_no_file_is_refused(folder):
    (folder / "captures.csv").write_bytes(b"file,stage_mm\n\xff\xfe.png,1\n")
    with pytest.raises(PsflutError, match="UTF-8"):
        read_manifest(folder / "captures.csv")
    for path in (folder / "none.csv", folder):
        with pytest.raises(PsflutError, match="no manifest"):
            read_manifest(path)


def test_too_few_positions_are_refused_only_where_more_are_needed(folder):
    text = "file,stage_mm\na.png,1\nb.png,1\nc.png,2\n"
    assert len(manifest_of(folder, text).positions) == 2
    with pytest.raises(PsflutError, match="2 distinct positions, expected 3"):
        manifest_of(folder, text, least_positions=3)


def test_links_are_followed_inside_the_folder_and_never_out_of_it(folder, tmp_path_factory):
    outside = tmp_path_factory.mktemp("outside")
    (folder / "a.png").rename(outside / "a.png")
    (folder / "a.png").symlink_to(outside / "a.png")
    (folder / "away").symlink_to(outside, target_is_directory=True)
    (folder / "again.png").symlink_to(folder / "b.png")
    (folder / "circle.png").symlink_to(folder / "circle.png")
    for name in ("a.png", "away/a.png"):
        with pytest.raises(PsflutError, match=r"row 2: .* leaves the manifest's folder"):
            manifest_of(folder, f"file,stage_mm\n{name},1\n")
    with pytest.raises(PsflutError, match=r"row 2: no file 'circle.png'"):
        manifest_of(folder, "file,stage_mm\ncircle.png,1\n")
    with pytest.raises(PsflutError, match=r"row 3: again.png is listed twice"):
        manifest_of(folder, "file,stage_mm\nb.png,1\nagain.png,2\n")
    assert len(manifest_of(folder, "file,stage_mm\nagain.png,2\n").rows) == 1
    (outside / "whole").symlink_to(folder, target_is_directory=True)
    assert len(read_manifest(outside / "whole" / "captures.csv").rows) == 1


def test_a_frame_that_shows_several_targets_is_read_once(folder):
    manifest = manifest_of(folder, "file,x,y,stage_um\na.png,3,4,1\n./a.png,9,4,1\nb.png,3,4,1\n")
    first, second, other = shots(manifest, manifest.positions[0])
    assert (first.centre, second.centre, other.centre) == ((4, 3), (4, 9), (4, 3))
    assert first.image is second.image is not other.image


def test_pages_of_a_stack_are_frames(folder):
    manifest = manifest_of(folder, "file,page,stage_um\nstack.tif,3,1\nstack.tif,0,2\na.png,,2\n")
    stack = tifffile.imread(folder / "stack.tif")
    (third,) = shots(manifest, manifest.positions[0])
    first, picture = shots(manifest, manifest.positions[1])
    np.testing.assert_allclose(third.image * 255, stack[3], atol=1e-12)
    np.testing.assert_allclose(first.image * 255, stack[0], atol=1e-12)
    assert (third.name, first.name, picture.name) == ("stack.tif page 3", "stack.tif page 0", "a.png")
    assert (third.position, first.centre) == (manifest.positions[0], None)


@pytest.mark.parametrize(
    ("kind", "dtype"),
    [
        ("a.jpg", np.uint8),
        ("a.png", np.uint8),
        ("a.png", np.uint16),
        ("a.tif", np.uint8),
        ("a.tif", np.uint16),
        ("a.tif", np.float32),
    ],
)
def test_full_scale_of_integers_is_no_measurement(tmp_path, kind, dtype):
    full = 1 if dtype == np.float32 else np.iinfo(dtype).max
    frame = np.full((16, 24), full / 5, dtype)
    frame[:8, :8] = full
    iio.imwrite(tmp_path / kind, frame)
    (shot,) = shots(manifest_of(tmp_path, f"file,stage_m\n{kind},0\n"), 0.0, gamma=2.0)
    expected = np.zeros((16, 24), bool)
    expected[:8, :8] = dtype != np.float32
    np.testing.assert_array_equal(np.isnan(shot.image), expected)
    assert np.nanmedian(shot.image) == pytest.approx(0.04, rel=0.01)


def test_one_saturated_channel_spoils_a_colour(tmp_path):
    colour = np.full((16, 24, 4), 100, np.uint8)
    colour[..., 3] = 255  # opaque is not saturated
    colour[3, 4, 2] = 255
    iio.imwrite(tmp_path / "a.png", colour)
    (shot,) = shots(manifest_of(tmp_path, "file,stage_m\na.png,0\n"), 0.0)
    assert np.argwhere(np.isnan(shot.image)).tolist() == [[3, 4]]


def test_the_dark_level_is_subtracted_after_the_encoding_is_undone(folder):
    manifest = manifest_of(folder, "file,stage_m\na.png,0\n")
    linear = (iio.imread(folder / "a.png") / 255.0) ** 2.0
    stack = (tifffile.imread(folder / "stack.tif") / 255.0) ** 2.0
    (by_number,) = shots(manifest, 0.0, gamma=2.0, dark=read_dark("0.01"))
    (by_frame,) = shots(manifest, 0.0, gamma=2.0, dark=read_dark(folder / "stack.tif", gamma=2.0))
    (as_it_is,) = shots(manifest, 0.0, gamma=2.0)
    np.testing.assert_allclose(by_number.image, linear - 0.01, atol=1e-14)
    np.testing.assert_allclose(by_frame.image, linear - stack.mean(axis=0), atol=1e-14)
    np.testing.assert_allclose(as_it_is.image, linear, atol=1e-14)


def test_a_dark_level_that_cannot_be_one_is_refused(folder):
    manifest = manifest_of(folder, "file,stage_m\na.png,0\n")
    with pytest.raises(PsflutError, match=r"dark frame has 10 x 30 pixels, .* 20 x 30"):
        shots(manifest, 0.0, dark=read_dark(folder / "small.png"))
    with pytest.raises(PsflutError, match=r"a.png is nowhere above the dark level"):
        shots(manifest, 0.0, dark=read_dark("100"))
    with pytest.raises(PsflutError, match="finite"):
        read_dark("nan")
    with pytest.raises(PsflutError, match="no image file"):
        read_dark("dark.png")


def test_frames_are_read_when_they_are_asked_for(folder):
    manifest = manifest_of(folder, "file,stage_m\na.png,0\nb.png,1\n")
    data = (folder / "b.png").read_bytes()
    (folder / "b.png").write_bytes(data[: len(data) // 2])
    assert len(shots(manifest, 0.0)) == 1
    with pytest.raises(PsflutError, match=r"b\.png"):
        shots(manifest, 1.0)


@pytest.mark.parametrize("level", [4095, 65520, 16383, 1023])
def test_the_ceiling_of_fewer_bits_is_saturation(tmp_path, level):
    """12 bits in a file of 16, low or shifted up; a peak that no others share, or at another level, is none."""
    rng = np.random.default_rng(0)
    for top, expected in ((level, 30), (level - 1, 0)):
        frame = rng.integers(level // 4, level // 2, (16, 24)).astype(np.uint16)
        frame[4:9, 4:10] = top
        iio.imwrite(tmp_path / "a.png", frame)
        for gamma in (1.0, 2.2):
            (shot,) = shots(manifest_of(tmp_path, "file,stage_m\na.png,0\n"), 0.0, gamma)
            assert np.isnan(shot.image).sum() == expected
    frame[4:9, 4:10] = level // 3
    frame[4, 4:6] = level
    iio.imwrite(tmp_path / "a.png", frame)
    assert not np.isnan(shots(manifest_of(tmp_path, "file,stage_m\na.png,0\n"), 0.0)[0].image).any()
