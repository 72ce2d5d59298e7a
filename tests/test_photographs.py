"""Photographs to compare with: those that ship, or a folder's."""

import numpy as np
import pytest

from psflut.errors import PsflutError
from psflut.photographs import SHIPPED, choose
from psflut.writing import write_png


def test_by_default_come_those_that_are_large_enough_for_the_patches():
    small, large = (dict(choose(None, size)) for size in (128, 256))
    assert set(small) == set(SHIPPED)
    assert set(large) < set(small)
    assert all(min(picture.shape) >= 256 for picture in large.values())
    for picture in small.values():
        assert picture.min() >= 0
        assert 0.1 < picture.max() <= 1
    with pytest.raises(PsflutError, match="--images"):
        choose(None, 5000)


def test_a_folder_gives_its_pictures_by_name_decoded_as_asked(tmp_path, rng):
    pictures = {f"{name}.png": np.round(255 * rng.random((8, 9))) / 255 for name in "ba"}
    for name, picture in pictures.items():
        write_png(tmp_path / name, picture)
    (tmp_path / "notes.txt").write_text("no picture")
    found = choose(str(tmp_path), 8)
    assert [name for name, _ in found] == ["a.png", "b.png"]
    np.testing.assert_allclose(found[0][1], pictures["a.png"])
    np.testing.assert_allclose(choose(str(tmp_path), 8, gamma=2.0)[0][1], pictures["a.png"] ** 2)


def test_what_names_no_photograph_is_refused(tmp_path):
    for images in ("camera,nonesuch", str(tmp_path / "absent"), str(tmp_path)):
        with pytest.raises(PsflutError, match=r"pictures|camera"):
            choose(images, 8)
