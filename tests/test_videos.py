"""Video files are sequences: a lossless one is the frames it was made of, and what cannot be read is told."""

from fractions import Fraction
from functools import partial

import numpy as np
import pytest
import tifffile

from psflut import videos
from psflut.errors import PsflutError
from psflut.images import read_image

av = pytest.importorskip("av", reason="PyAV is not installed: pip install psflut[video]")


def save(path, frames, pixels="gray", rate=20):
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=Fraction(rate))
        stream.height, stream.width, stream.pix_fmt = *frames.shape[1:3], pixels
        for frame in frames:
            picture = av.VideoFrame.from_ndarray(frame, format="rgb24" if pixels == "bgr0" else pixels)
            container.mux(stream.encode(picture))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize(
    ("pixels", "shape", "kind"),
    [("gray", (5, 48, 64), np.uint8), ("gray16le", (5, 48, 64), np.uint16), ("bgr0", (5, 48, 64, 3), np.uint8)],
)
def test_frames_come_back_in_any_order(pixels, shape, kind, rng, tmp_path):
    frames = rng.integers(0, np.iinfo(kind).max, shape, kind, endpoint=True)
    path = save(tmp_path / "clip.mkv", frames, pixels)
    assert videos.shapes(path) == ((48, 64),) * 5
    assert videos.rate(path) == 20
    for number in (0, 1, 4, 2):
        np.testing.assert_array_equal(videos.read(path, number), frames[number])


def test_a_video_is_mapped_as_its_frames_are(run, lab_patch, tmp_path):
    frames = np.round(255 * np.clip(np.stack([lab_patch, lab_patch[::-1]]), 0, 1)).astype(np.uint8)
    np.save(tmp_path / "clip.npy", frames)
    save(tmp_path / "clip.mkv", frames)
    for kind in ("npy", "mkv"):
        words = ("--table", "lab16mm", "--noise", "0.005", "-o", tmp_path / f"{kind}.tif")
        assert run("depthmap", tmp_path / f"clip.{kind}", *words) == 0
    one, other = (tifffile.imread(tmp_path / f"{kind}.tif") for kind in ("npy", "mkv"))
    np.testing.assert_array_equal(one, other)


def test_what_cannot_be_read_is_told(rng, tmp_path):
    whole = save(tmp_path / "clip.mkv", rng.integers(0, 255, (8, 48, 64), np.uint8))
    with pytest.raises(PsflutError, match=r"clip.mkv is a video of 8 frames; map it whole"):
        read_image(whole)
    (tmp_path / "torn.mkv").write_bytes(whole.read_bytes()[:-12_000])
    with pytest.raises(PsflutError, match=r"torn.mkv"):
        list(map(partial(read_image, tmp_path / "torn.mkv", 1.0, False), range(8)))
    (tmp_path / "none.mp4").write_bytes(b"no video at all" * 40)
    with pytest.raises(PsflutError, match=r"cannot read .*none.mp4"):
        read_image(tmp_path / "none.mp4")


def test_a_playlist_does_not_pass_for_a_video(rng, tmp_path):
    """ffmpeg would look into the file rather than at its name, and open what the list names."""
    save(tmp_path / "clip.mkv", rng.integers(0, 255, (8, 48, 64), np.uint8))
    (tmp_path / "list.mp4").write_text(f"#EXTM3U\n#EXTINF:1,\n{tmp_path / 'clip.mkv'}\n#EXT-X-ENDLIST\n")
    with pytest.raises(PsflutError, match=r"cannot read .*list.mp4"):
        read_image(tmp_path / "list.mp4", page=0)
