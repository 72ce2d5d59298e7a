"""Texts with mistakes in them, for tests of what reads them."""

CAMERA = 'focal_length = "16 mm"\nf_number = 2\nfocus_distance = "6 m"\npixel_pitch = "6 um"\n'


def camera(old="", new="", more=""):
    assert old in CAMERA
    return f"[camera]\n{CAMERA.replace(old, new)}{more}"


TABLE = 'model = "gaussian"\ndistances = { from = "1 m", to = "3 m", count = 4 }\nsize = 41\n'


def recipe(old="", new="", more="", capture=""):
    assert old in TABLE
    return f"[camera]\n{CAMERA}[table]\n{TABLE.replace(old, new)}{more}{capture and '[capture]' + chr(10)}{capture}"


def spoilt(desk, text):
    (desk / "spoilt").write_bytes(text if isinstance(text, bytes) else text.encode())
    return "spoilt"
