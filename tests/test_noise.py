import numpy as np
import pytest

from psflut.errors import PsflutError
from psflut.noise import Noise, estimate_noise, parse_noise, thesis_noise


def test_variance_is_read_and_shot():
    noise = Noise(read=0.01, gain=1000.0, offset=0.1)
    assert noise.shot_variance(0.6) == pytest.approx(0.5 / 1000)
    assert noise.shot_variance(0.05) == 0.0


def test_quantisation_adds_a_twelfth_of_a_step_squared(rng):
    values = rng.random(200_000)
    rounded = np.round(values * 15) / 15
    expected = Noise(1e-9).with_quantisation(4).read
    assert np.std(rounded - values) == pytest.approx(expected, rel=0.01)


def test_the_two_readings_of_the_thesis(rng):
    capture = 0.3 * rng.random((64, 64))
    assert thesis_noise("variance", 1e-3, capture).read ** 2 == pytest.approx(1e-3)
    assert parse_noise("relative:1e-3", capture).read ** 2 == pytest.approx(1e-3 * capture.var())
    assert parse_noise("0.005", capture).read == 0.005


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "much", "variance:", "absolute:1e-3", "variance:-1"])
def test_what_is_no_noise_is_refused(text):
    with pytest.raises(PsflutError):
        parse_noise(text, np.zeros((4, 4)) + np.eye(4))


def test_noise_is_found_in_a_blurred_image(lab16mm, scene):
    from psflut.capture import Setup, simulate

    for sigma in (0.002, 0.01, 0.03):
        image, _ = simulate(scene, lab16mm, 1.2, Setup(noise=str(sigma)), seed=3)
        assert estimate_noise(image).read == pytest.approx(sigma, rel=0.1)


def test_estimated_noise_is_never_below_quantisation():
    assert estimate_noise(np.full((64, 64), 0.5), quantum=1 / 255).read == pytest.approx(1 / 255 / np.sqrt(12))
