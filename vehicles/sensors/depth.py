"""A stereo depth camera with noise, from the true depth of a rendered image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.readings import CameraReading, DepthImage, DepthReading
from wil_campaign.vehicles.sensors.images import DEPTH_TRAITS
from wil_campaign.vehicles.sensors.noise_sets import NoiseSets
from wil_campaign.vehicles.sensors.sensor_spec import SensorSpec

_SPARE_PX = 64
"""By how much the noise tile exceeds the image: each image takes another offset in it."""


@dataclass(frozen=True, slots=True)
class DepthNoise:
    """The noise of a stereo depth camera: sigma = z^2 * subpixel / (focal length * baseline).

    Formula: Intel, "Tuning depth cameras for best performance", which wants the subpixel error
    below 0.1 px; 0.08 is a well textured scene. Baseline and reach: RealSense D400 data sheet,
    D435, 50 mm, from 0.28 m at 1280x720, to about 10 m. subpixel_px 0 is no noise. Fresh noise
    for every pixel costs 10 ms, so that a tile drawn once is used at another offset each time.
    """

    subpixel_px: float = 0.08
    baseline_m: float = 0.050
    range_min_m: float = 0.28
    range_max_m: float = 10.0


NO_DEPTH_NOISE = DepthNoise(subpixel_px=0.0, range_min_m=0.0, range_max_m=np.inf)
DEPTH_NOISES = NoiseSets(ideal=NO_DEPTH_NOISE, datasheet=DepthNoise())


class DepthSensor:
    """A depth sensor: from images with true depth to depth readings; keeps its noise."""

    def __init__(self, *, noise: DepthNoise = NO_DEPTH_NOISE) -> None:
        self._noise = noise
        self._tile: NDArray[np.float32] | None = None

    def sample(self, image: CameraReading, rng: np.random.Generator) -> DepthReading:
        """Return the depth reading of an image, at its time. Raises ValueError without depth."""
        if image.depth_m is None:
            raise ValueError(f"image {image.seq} of {image.source} has no depth_m")
        return DepthReading(
            t_s=image.t_s,
            arrived_s=image.arrived_s,
            seq=image.seq,
            source=image.source,
            depth_m=self._add_noise(image.depth_m, image.intrinsics.fx_px, rng),
            intrinsics=image.intrinsics,
            object_ids=image.object_ids,
            camera_pose=image.camera_pose,
            rendered=image.rendered,
        )

    def _add_noise(self, depth_m: DepthImage, fx_px: float, rng: np.random.Generator) -> DepthImage:
        noise = self._noise
        if noise == NO_DEPTH_NOISE:
            return depth_m
        lost = (depth_m < noise.range_min_m) | (depth_m > noise.range_max_m)
        seen = np.where(lost, np.float32(0.0), depth_m)
        gain = np.float32(noise.subpixel_px / (fx_px * noise.baseline_m))
        disturbed: DepthImage = seen * gain
        disturbed *= self._noise_window(depth_m.shape, rng)
        disturbed += np.float32(1.0)
        disturbed *= seen
        np.maximum(disturbed, np.float32(0.0), out=disturbed)
        disturbed[lost] = np.inf
        return disturbed

    def _noise_window(
        self, shape: tuple[int, ...], rng: np.random.Generator
    ) -> NDArray[np.float32]:
        height, width = shape
        wanted = (height + _SPARE_PX, width + _SPARE_PX)
        if self._tile is None or self._tile.shape != wanted:
            self._tile = rng.standard_normal(wanted, dtype=np.float32)
        row, column = rng.integers(0, _SPARE_PX, 2).tolist()
        return self._tile[row : row + height, column : column + width]


DEPTH = SensorSpec("depth", DepthReading, traits=DEPTH_TRAITS)
