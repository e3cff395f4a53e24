"""Samples of an image: the pixels at which virtual objects are compared with geometry. Pure."""

from dataclasses import replace

from wil_campaign.worlds.camera import Intrinsics

_SAMPLES = 160
"""Largest number of compared columns of an image: outlines are accurate to a few pixels, for a
twentieth of the time of rendering the image."""


def image_samples_of(intrinsics: Intrinsics) -> slice:
    """Return the rows and columns of an image at which the expected view is compared."""
    step = -(-intrinsics.width_px // _SAMPLES)
    return slice(step // 2, None, step)


def sampled_intrinsics(intrinsics: Intrinsics) -> Intrinsics:
    """Return the camera whose pixels are the compared samples of another."""
    part = image_samples_of(intrinsics)
    step, first = part.step, part.start
    return replace(
        intrinsics,
        width_px=len(range(first, intrinsics.width_px, step)),
        height_px=len(range(first, intrinsics.height_px, step)),
        fx_px=intrinsics.fx_px / step,
        fy_px=intrinsics.fy_px / step,
        cx_px=(intrinsics.cx_px - first) / step,
        cy_px=(intrinsics.cy_px - first) / step,
    )
