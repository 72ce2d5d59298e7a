"""Camera files that say what cannot be: refused in a sentence that names them."""

import pytest
from texts import CAMERA, camera, spoilt

from psflut.camera_file import read_camera
from psflut.errors import PsflutError

CAMERAS = {
    "empty": "",
    "no section": CAMERA,
    "another section": camera() + "[lens]\nname = 1\n",
    "camera a list": 'camera = ["16 mm"]\n',
    "camera text": 'camera = "16 mm"\n',
    "two cameras": camera() + camera(),
    "two sections of one name": "[[camera]]\n" + CAMERA + "[[camera]]\n" + CAMERA,
    "a key twice": camera(more='pixel_pitch = "6 um"\n'),
    "a misspelt key": camera("focal_length", "focal_lenght"),
    "a key too many": camera(more='colour = "red"\n'),
    "no focal length": camera('focal_length = "16 mm"\n'),
    "no pitch": camera('pixel_pitch = "6 um"\n'),
    "no aperture": camera("f_number = 2\n"),
    "no focus": camera('focus_distance = "6 m"\n'),
    "two apertures": camera(more='aperture_diameter = "8 mm"\n'),
    "two foci": camera(more='detector_distance = "17 mm"\n'),
    "a bare number": camera('"16 mm"', "16"),
    "no unit": camera('"16 mm"', '"16"'),
    "an unknown unit": camera('"16 mm"', '"16 inch"'),
    "a unit alone": camera('"16 mm"', '"mm"'),
    "two units": camera('"16 mm"', '"16 mm mm"'),
    "a comma": camera('"16 mm"', '"1,6 mm"'),
    "true": camera('"16 mm"', "true"),
    "a list": camera('"16 mm"', '["16 mm"]'),
    "a date": camera('"16 mm"', "2026-01-01"),
    "a negative length": camera('"16 mm"', '"-16 mm"'),
    "a length of zero": camera('"16 mm"', '"0 mm"'),
    "a length not a number": camera('"16 mm"', '"nan mm"'),
    "an infinite length": camera('"16 mm"', '"1e999 mm"'),
    "an infinite pitch": camera('"6 um"', '"inf um"'),
    "a pitch of zero": camera('"6 um"', '"0 um"'),
    "a focus inside the lens": camera('"6 m"', '"1 mm"'),
    "a focus at the focal length": camera('"6 m"', '"16 mm"'),
    "a detector before the focus": camera('focus_distance = "6 m"', 'detector_distance = "15 mm"'),
    "an f-number of zero": camera("f_number = 2", "f_number = 0"),
    "a negative f-number": camera("f_number = 2", "f_number = -2"),
    "an f-number of text": camera("f_number = 2", 'f_number = "f/2"'),
    "an infinite f-number": camera("f_number = 2", "f_number = inf"),
    "an f-number not a number": camera("f_number = 2", "f_number = nan"),
    "a wavelength of zero": camera(more='wavelength = "0 nm"\n'),
    "a wavelength without unit": camera(more="wavelength = 550\n"),
    "quotes without end": '[camera]\nfocal_length = "16 mm\n',
    "brackets without end": "[camera\n",
    "nested too deep": "a = " + "[" * 100_000,
    "keys nested too deep": "a." * 2_000 + "b = 1\n",
    "Latin-1": '[camera]\npixel_pitch = "6 \xb5m"\n'.encode("latin-1"),
    "UTF-16": camera().encode("utf-16"),
    "nulls": bytes(100),
    "nonsense": bytes(range(256)),
    "JSON": '{"camera": {"focal_length": "16 mm"}}',
}


@pytest.mark.parametrize("case", CAMERAS)
def test_a_camera_file_is_refused(refused, desk, case):
    words = ["simulate", "image.png", "--distance", "1.2 m", "-o", "o.tif", "--camera", spoilt(desk, CAMERAS[case])]
    assert "spoilt" in refused(*words)
    with pytest.raises(PsflutError, match="spoilt"):
        read_camera(desk / "spoilt")


def test_the_control_whole_camera_files_are_read(desk):
    for text in (camera(), "\ufeff" + camera().replace("\n", "\r\n")):
        assert read_camera(desk / spoilt(desk, text)).f_number == pytest.approx(2)
