"""Photometry of a camera: level, colour cast, noise, blur; measured, and matched to another's.

Noise: Immerkaer, "Fast Noise Variance Estimation" (1996), with the median in place of the mean, so
that edges do not count as noise. Blur: the height of an edge over its steepest slope; for a step
blurred by a Gaussian of sigma s, the central difference is half of erf(1 / (s sqrt 2)) of it.
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.readings import BgrImage, Mask

_SAMPLE_PX = 160
"""Number of columns and rows of the image on which levels are measured, about."""
_CROP_PX = (480, 640)
"""Noise and blur are measured at full size in the middle of the image."""
_DARK, _BRIGHT = 8, 247
"""Beyond these a pixel may be saturated, and is not used."""
_SHARPEST = 85.0
"""Percentile of the steepness of edges: some are soft in the scene, or two are in one window."""
_LEAST_EDGES = 40
_LEAST_CONTRAST = 40.0
_MAD = 0.6745
"""Median of the absolute value of a standard normal variable."""

_LAPLACIAN = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)


@dataclass(frozen=True, slots=True)
class CameraPhotometry:
    """The photometry of a camera: level, noise, blur; None where an image cannot show it.

    level_bgr: median of each channel, grey levels. noise_std_dn: grey levels. blur_sigma_px: of
    the sharpest of the edges.
    """

    level_bgr: tuple[float, float, float] | None = None
    noise_std_dn: float | None = None
    blur_sigma_px: float | None = None


def measure_photometry(image_bgr: BgrImage) -> CameraPhotometry:
    """Return the photometry measured in a (height, width, 3) uint8 image."""
    rows, columns = (
        slice(max(0, (length - crop) // 2), max(0, (length - crop) // 2) + crop)
        for length, crop in zip(image_bgr.shape[:2], _CROP_PX, strict=True)
    )
    gray = cv2.cvtColor(image_bgr[rows, columns], cv2.COLOR_BGR2GRAY).astype(np.float32)
    return CameraPhotometry(_level(image_bgr), _noise(image_bgr[rows, columns]), _blur(gray))


def _level(image_bgr: BgrImage) -> tuple[float, float, float] | None:
    """Return the median blue, green, red of an image; None where 95 % is too dark or too bright."""
    steps = [max(1, length // _SAMPLE_PX) for length in image_bgr.shape[:2]]
    pixels = image_bgr[:: steps[0], :: steps[1]].reshape(-1, 3)
    usable = pixels[((pixels > _DARK) & (pixels < _BRIGHT)).all(axis=1)]
    if len(usable) < max(1, len(pixels) // 20):
        return None
    blue, green, red = (float(level) for level in np.median(usable, axis=0))
    return (blue, green, red)


def _noise(image_bgr: BgrImage) -> float | None:
    """Return the noise of an image, standard deviation in grey levels; None if not measurable."""
    if min(image_bgr.shape[:2]) < 8:
        return None
    green = image_bgr[:, :, 1]
    bent = cv2.filter2D(green.astype(np.float32), -1, _LAPLACIAN)[1:-1, 1:-1]
    usable = (green[1:-1, 1:-1] > _DARK) & (green[1:-1, 1:-1] < _BRIGHT)
    if usable.sum() < 100:
        return None
    std = float(np.median(np.abs(bent[usable]))) / (6.0 * _MAD)
    # Rounding to whole levels has a standard deviation of its own.
    return math.sqrt(max(0.0, std * std - 1.0 / 12.0))


def _blur(gray: NDArray[np.float32]) -> float | None:
    """Return the blur of a grey image, sigma in pixels; None if not measurable."""
    if min(gray.shape) < 32:
        return None
    across = cv2.filter2D(gray, -1, np.array([[-0.5, 0.0, 0.5]], np.float32))
    down = cv2.filter2D(gray, -1, np.array([[-0.5], [0.0], [0.5]], np.float32))
    slope = np.maximum(np.abs(across), np.abs(down))
    window = np.ones((13, 13), np.uint8)
    height = cv2.dilate(gray, window) - cv2.erode(gray, window)
    # Of several edges in a window only the steepest belongs to its height.
    crest = slope >= cv2.dilate(slope, window) * 0.999
    edges = crest & (height > _LEAST_CONTRAST)
    edges[:7], edges[-7:], edges[:, :7], edges[:, -7:] = False, False, False, False
    if edges.sum() < _LEAST_EDGES:
        return None
    steepness = np.clip(slope[edges] / height[edges], 0.0, 0.5)
    return float(np.interp(np.percentile(steepness, _SHARPEST), _STEEPNESS, _SIGMAS_PX))


_SIGMAS_PX = np.linspace(8.0, 0.05, 400)
_STEEPNESS = np.array([math.erf(1.0 / (s * math.sqrt(2.0))) / 2.0 for s in _SIGMAS_PX])


@dataclass(frozen=True, slots=True)
class PhotometricCorrection:
    """A photometric correction of an image. gains_bgr: factors; noise and blur are added."""

    gains_bgr: tuple[float, float, float] = (1.0, 1.0, 1.0)
    noise_std_dn: float = 0.0
    blur_sigma_px: float = 0.0

    def towards(self, other: "PhotometricCorrection", share: float) -> "PhotometricCorrection":
        """Return the correction a share of the way to another, to avoid flicker."""

        def mix(a: float, b: float) -> float:
            return a + (b - a) * share

        blue, green, red = (mix(a, b) for a, b in zip(self.gains_bgr, other.gains_bgr, strict=True))
        return PhotometricCorrection(
            (blue, green, red),
            mix(self.noise_std_dn, other.noise_std_dn),
            mix(self.blur_sigma_px, other.blur_sigma_px),
        )


def photometric_correction(
    mine: CameraPhotometry,
    theirs: CameraPhotometry,
    *,
    max_gain: float,
    exposure: bool,
    white_balance: bool,
) -> PhotometricCorrection:
    """Return the photometric correction that makes one camera's image look like another's.

    Gains are the ratios of the medians: the same for all channels when only the exposure is
    matched, relative to their mean when only the white is; each within 1/max_gain to max_gain.
    Noise and blur can only be added.
    """
    return PhotometricCorrection(
        _gains(mine, theirs, max_gain, exposure=exposure, white_balance=white_balance),
        _add_noise(mine.noise_std_dn, theirs.noise_std_dn),
        _add_noise(mine.blur_sigma_px, theirs.blur_sigma_px),
    )


def _gains(
    mine: CameraPhotometry,
    theirs: CameraPhotometry,
    max_gain: float,
    *,
    exposure: bool,
    white_balance: bool,
) -> tuple[float, float, float]:
    """Return the gains of blue, green, red that match exposure and white balance of two images."""
    if mine.level_bgr is None or theirs.level_bgr is None:
        return (1.0, 1.0, 1.0)
    ratios = np.array(theirs.level_bgr) / np.maximum(mine.level_bgr, 1.0)
    common = float(np.exp(np.log(np.maximum(ratios, 1e-3)).mean()))
    if not white_balance:
        ratios = np.full(3, common)
    if not exposure:
        ratios = ratios / common
    blue, green, red = (float(gain) for gain in np.clip(ratios, 1.0 / max_gain, max_gain))
    return (blue, green, red)


def _add_noise(mine: float | None, theirs: float | None) -> float:
    """Return the noise to add to an image to match another's; 0 when not measured."""
    if mine is None or theirs is None:
        return 0.0
    return math.sqrt(max(0.0, theirs * theirs - mine * mine))


_ROLL_PX = 128
_LEAST_BLUR_PX = 0.3
_LEVELS = 32.0
"""Steps of the noise tile within one standard deviation."""


class PhotometricCorrector:
    """Applies photometric corrections to images of one size; its noise repeats to the byte.

    Noise is taken from a tile, shifted by `seq`: drawing new noise costs ten times as much.
    """

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._tile: NDArray[np.uint8] | None = None

    def applied(
        self, image_bgr: BgrImage, mask: Mask | None, what: PhotometricCorrection, seq: int
    ) -> BgrImage:
        """Return the image with blur, exposure and noise corrected.

        mask: of the kept pixels; blur uses these only, so that the object's edge does not get the
        colour of its old background.
        """
        made = _blur_image(image_bgr, mask, what.blur_sigma_px)
        if what.gains_bgr != (1.0, 1.0, 1.0):
            made = cv2.LUT(made, _gain_table(what.gains_bgr))
        if what.noise_std_dn >= 0.2:
            made = self._noisy(made, what.noise_std_dn, seq)
        return made

    def _noisy(self, image_bgr: BgrImage, std_dn: float, seq: int) -> BgrImage:
        """Return the image with noise of a standard deviation added, by its sequence number."""
        height_px, width_px = image_bgr.shape[:2]
        wanted = (height_px + _ROLL_PX, width_px + _ROLL_PX, 3)
        if self._tile is None or self._tile.shape != wanted:
            normal = np.random.default_rng(self._seed).standard_normal(wanted, np.float32)
            self._tile = np.clip(np.rint(normal * _LEVELS + 128.0), 0, 255).astype(np.uint8)
        down, right = (seq * 37) % _ROLL_PX, (seq * 59) % _ROLL_PX
        laid = np.ascontiguousarray(self._tile[down : down + height_px, right : right + width_px])
        levels = np.rint((np.arange(256) - 128.0) / _LEVELS * std_dn)
        brighter = np.clip(levels, 0, 255).astype(np.uint8)
        darker = np.clip(-levels, 0, 255).astype(np.uint8)
        made = cv2.add(image_bgr, cv2.LUT(laid, brighter))
        noisy: BgrImage = cv2.subtract(made, cv2.LUT(laid, darker), dst=made)
        return noisy


def _gain_table(gains_bgr: tuple[float, float, float]) -> NDArray[np.uint8]:
    """Return the lookup table that applies gains to an image."""
    levels = np.arange(256)[:, None] * np.array(gains_bgr)
    table: NDArray[np.uint8] = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    return table.reshape(1, 256, 3)


def _blur_image(image_bgr: BgrImage, mask: Mask | None, sigma_px: float) -> BgrImage:
    """Return an image blurred by a sigma in pixels, within a mask."""
    if sigma_px < _LEAST_BLUR_PX:
        return image_bgr
    if mask is None:
        soft: BgrImage = cv2.GaussianBlur(image_bgr, (0, 0), sigma_px)
        return soft
    left, top, across, down = cv2.boundingRect(mask)
    if not across or not down:
        return image_bgr
    reach = math.ceil(3 * sigma_px)
    rows = slice(max(0, top - reach), top + down + reach)
    columns = slice(max(0, left - reach), left + across + reach)
    weight = (mask[rows, columns] != 0).astype(np.float32)
    part = image_bgr[rows, columns] * weight[:, :, None]
    spread = cv2.GaussianBlur(weight, (0, 0), sigma_px)
    inside = weight > 0.0
    smooth = cv2.GaussianBlur(part, (0, 0), sigma_px) / np.maximum(spread, 1e-3)[:, :, None]
    made = image_bgr.copy()
    made[rows, columns][inside] = np.clip(np.rint(smooth[inside]), 0, 255).astype(np.uint8)
    return made


def photometry_with_known(
    look: CameraPhotometry, *, noise_std_dn: float | None, blur_sigma_px: float | None
) -> CameraPhotometry:
    """Return the photometry with known camera values in place of the measured ones."""
    if noise_std_dn is not None:
        look = replace(look, noise_std_dn=noise_std_dn)
    return look if blur_sigma_px is None else replace(look, blur_sigma_px=blur_sigma_px)
