"""A camera's effects on an image: motion blur, exposure and noise; pure and cheap.

Noise comes from a tile that is drawn once and shifted for each image: fresh noise of NumPy costs
9.8 ms for an image of 640x480, the tile 0.2 ms.
"""

from dataclasses import dataclass
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.embedded.profile import CameraFaults
from wil_campaign.vehicles.readings import BgrImage, DrawnEffects
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

BLUR_DISTANCE_M = 3.0
"""Assumed distance of the blurred scene: that of the gate in the paper's first scenario."""

MAX_STREAK_PX = 40
NOISE_ROLL_PX = 128
"""By how much the noise tile exceeds the image, and so the number of its offsets."""

Streak = tuple[float, float]
NO_STREAK: Streak = (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class CameraQuality:
    """The effects of a camera: blur, gain, noise; the default is a perfect one.

    noise_std_dn, offset_dn: grey levels of 8 bits; gain: a factor, before the offset. exposure_s:
    how long the shutter is open. latency_s: from the middle of the exposure to delivery;
    jitter_s: its standard deviation.
    """

    noise_std_dn: float = 0.0
    gain: float = 1.0
    offset_dn: float = 0.0
    exposure_s: float = 0.0
    latency_s: float = 0.0
    jitter_s: float = 0.0

    @classmethod
    def of_profile(cls, faults: CameraFaults) -> Self:
        """Return the camera effects that a vehicle's profile gives its camera."""
        return cls(
            noise_std_dn=faults.noise_std,
            gain=faults.gain,
            offset_dn=faults.offset,
            exposure_s=faults.exposure_s,
            latency_s=faults.latency_s,
            jitter_s=faults.jitter_s,
        )


class CameraEffects:
    """Applies camera effects to rendered images.

    rng: fresh, as its seed made it. Thread-safe: it is not written to after construction.
    """

    def __init__(
        self, quality: CameraQuality, intrinsics: Intrinsics, rng: np.random.Generator
    ) -> None:
        self._quality = quality
        self._seed = _seed_of(rng)
        self._table = _exposure_table(quality)
        self._noise = _noise_tile(quality, intrinsics, rng)

    @classmethod
    def again(cls, drawn: DrawnEffects, intrinsics: Intrinsics) -> Self:
        """Return the effects of a drawn image's camera, with equal noise."""
        quality = CameraQuality(drawn.noise_std_dn, drawn.gain, drawn.offset_dn)
        return cls(quality, intrinsics, np.random.default_rng(drawn.seed))

    def drawn(self, streak_px: Streak, noise_roll_px: tuple[int, int]) -> DrawnEffects:
        """Return what `apply` does with these arguments, to be done again."""
        quality = self._quality
        return DrawnEffects(
            self._seed,
            quality.noise_std_dn,
            quality.gain,
            quality.offset_dn,
            streak_px,
            noise_roll_px,
        )

    def apply(
        self, image_bgr: BgrImage, *, streak_px: Streak, noise_roll_px: tuple[int, int]
    ) -> BgrImage:
        """Return the image with motion blur along a streak, exposure and noise.

        streak_px: how far it moved to the right and down while the shutter was open.
        noise_roll_px: the offset in the noise tile, down and right, each from 0 to NOISE_ROLL_PX.
        The given image is not written to, and is returned itself when no effect applies.
        """
        image_bgr = blur_image(image_bgr, streak_px)
        if self._table is not None:
            image_bgr = cv2.LUT(image_bgr, self._table)
        if self._noise is not None:
            down, right = noise_roll_px
            height_px, width_px = image_bgr.shape[:2]
            brighter, darker = (
                tile[down : down + height_px, right : right + width_px] for tile in self._noise
            )
            image_bgr = cv2.add(image_bgr, brighter)
            cv2.subtract(image_bgr, darker, dst=image_bgr)
        return image_bgr


def _seed_of(rng: np.random.Generator) -> tuple[int, ...]:
    """Return the numbers that a generator was made of."""
    # NumPy types its seed as one of any kind; default_rng makes a SeedSequence.
    entropy: Any = getattr(rng.bit_generator.seed_seq, "entropy", ())
    return tuple(int(number) for number in np.atleast_1d(np.array(entropy, dtype=object)))


def blur_image(image_bgr: BgrImage, streak_px: Streak) -> BgrImage:
    """Return the image with motion blur along a line; itself below a pixel.

    One line for the whole image, rather than several renderings: it costs one small convolution,
    and it neglects that blur varies over the image when the camera rolls or objects move.
    """
    length_px = max(abs(streak_px[0]), abs(streak_px[1]))
    if not length_px >= 1.0:
        return image_bgr
    shrink = min(1.0, MAX_STREAK_PX / length_px)
    kernel = _line_kernel((streak_px[0] * shrink, streak_px[1] * shrink))
    smeared: BgrImage = cv2.filter2D(image_bgr, -1, kernel, borderType=cv2.BORDER_REPLICATE)
    return smeared


def _line_kernel(streak_px: Streak) -> NDArray[np.float32]:
    """Return the kernel of motion blur: a line as long as the streak, summing to 1."""
    reach = int(np.ceil(max(abs(streak_px[0]), abs(streak_px[1])) / 2.0))
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    for fraction in np.linspace(-0.5, 0.5, 4 * reach + 1):
        x, y = reach + streak_px[0] * fraction, reach + streak_px[1] * fraction
        kernel[round(y), round(x)] += 1.0
    kernel /= kernel.sum()
    return kernel


def motion_streak_px(start: Pose, end: Pose, intrinsics: Intrinsics) -> Streak:
    """Return the camera's motion blur between two poses, pixels right and down.

    Of the point that was straight ahead, BLUR_DISTANCE_M away; none when it leaves the front.
    """
    pixel = intrinsics.project(end.to_local(start.to_parent((BLUR_DISTANCE_M, 0.0, 0.0))))
    if pixel is None:
        return NO_STREAK
    return (pixel[0] - intrinsics.cx_px, pixel[1] - intrinsics.cy_px)


def _exposure_table(quality: CameraQuality) -> NDArray[np.uint8] | None:
    """Return the lookup table of the camera's gain and offset; None for neither."""
    if quality.gain == 1.0 and quality.offset_dn == 0.0:
        return None
    levels = np.arange(256) * quality.gain + quality.offset_dn
    table: NDArray[np.uint8] = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    return table


def _noise_tile(
    quality: CameraQuality, intrinsics: Intrinsics, rng: np.random.Generator
) -> tuple[BgrImage, BgrImage] | None:
    """Return the camera's noise to add and to subtract; two, so that both saturate."""
    if quality.noise_std_dn == 0.0:
        return None
    shape = (intrinsics.height_px + NOISE_ROLL_PX, intrinsics.width_px + NOISE_ROLL_PX, 3)
    noise = np.rint(rng.standard_normal(shape, np.float32) * quality.noise_std_dn)
    return (
        np.clip(noise, 0, 255).astype(np.uint8),
        np.clip(-noise, 0, 255).astype(np.uint8),
    )
