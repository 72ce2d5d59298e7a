"""Lenses through which PSFs are tested, and what is asked of a PSF."""

import numpy as np

from psflut.optics import Camera, distance_at_blur

THESIS = Camera(focal_length=0.1, aperture_diameter=6e-3, detector_distance=0.101, pixel_pitch=25e-6)
LAB = Camera.of(focus_distance=6.0, focal_length=16e-3, aperture_diameter=8e-3, pixel_pitch=6e-6)


def at_radius(camera, pixels):
    """Distance at which the geometric blur disc has this signed radius, in pixels."""
    return float(distance_at_blur(camera, pixels * camera.pixel_pitch))


def moments(psf):
    """Centroid (x, y) and second moments (xx, yy, xy) about it, in pixels from the central one."""
    y, x = np.mgrid[: len(psf), : len(psf)] - len(psf) // 2
    mx, my = np.sum(psf * x), np.sum(psf * y)
    second = [np.sum(psf * a) for a in ((x - mx) ** 2, (y - my) ** 2, (x - mx) * (y - my))]
    return mx, my, *second


def cropped(psf, size):
    """The middle of a larger window, renormalised."""
    edge = (len(psf) - size) // 2
    return psf[edge:-edge, edge:-edge] / psf[edge:-edge, edge:-edge].sum()
