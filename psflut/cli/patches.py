"""What commands make of an image and the options that go with it."""

from typing import TYPE_CHECKING

from psflut.errors import PsflutError

if TYPE_CHECKING:
    from psflut.estimation import Observation
    from psflut.images import Picture


def observe(
    picture: "Picture", noise: str | None, imager: str | None, known: "Picture | None", patch: str | None
) -> "Observation":
    """The patch of a picture that an option names, and of the ideal image where that is known."""
    from psflut.estimation import Observation
    from psflut.images import crop
    from psflut.noise import parse_noise

    if known is not None:
        same_shape("scene", known, picture)
    window = crop(picture.image.shape, patch)
    return Observation(
        picture.image[window],
        noise=None if noise is None else parse_noise(noise, picture.image[window]),
        imager=imager,
        scene=None if known is None else known.image[window],
        quantum=picture.quantum,
    )


def same_shape(what: str, other: "Picture", picture: "Picture") -> None:
    """Refuse a picture that does not lie over the capture."""
    if other.image.shape != picture.image.shape:
        raise PsflutError(f"the {what} has the shape {other.image.shape}, not {picture.image.shape}; they must agree")
