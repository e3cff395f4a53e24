"""A stereo depth camera, made from the distances of a rendered picture."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicles.readings import CameraReading, DepthImage, DepthReading
from vehicles.sensors.noise_sets import NoiseSets

_SPARE_PX = 64
"""By how much the noise tile is larger than the picture: it is laid anew for each picture."""


@dataclass(frozen=True, slots=True)
class DepthNoise:
    """The noise of a stereo depth camera: sigma = z^2 * subpixel / (focal length * baseline).

    Formula: Intel, "Tuning depth cameras for best performance", which wants the subpixel error
    below 0.1 px; 0.08 is a well textured scene. Baseline and reach: RealSense D400 data sheet,
    D435, 50 mm, from 0.28 m at 1280x720, to about 10 m. subpixel_px 0 is no noise. Fresh noise
    for every pixel costs 10 ms, so that a tile drawn once is laid at another place each time.
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

    def sample(self, picture: CameraReading, rng: np.random.Generator) -> DepthReading:
        """Return the depth reading of an image, at its time. Raises ValueError without depth."""
        if picture.depth_m is None:
            raise ValueError(f"picture {picture.seq} of {picture.source} has no depth_m")
        return DepthReading(
            t_s=picture.t_s,
            arrived_s=picture.arrived_s,
            seq=picture.seq,
            source=picture.source,
            depth_m=self._add_noise(picture.depth_m, picture.intrinsics.fx_px, rng),
            intrinsics=picture.intrinsics,
            object_ids=picture.object_ids,
            camera_pose=picture.camera_pose,
            rendered=picture.rendered,
        )

    def _add_noise(self, depth_m: DepthImage, fx_px: float, rng: np.random.Generator) -> DepthImage:
        noise = self._noise
        if noise == NO_DEPTH_NOISE:
            return depth_m
        lost = (depth_m < noise.range_min_m) | (depth_m > noise.range_max_m)
        seen = np.where(lost, np.float32(0.0), depth_m)
        gain = np.float32(noise.subpixel_px / (fx_px * noise.baseline_m))
        disturbed: DepthImage = seen * gain
        disturbed *= self._laid(depth_m.shape, rng)
        disturbed += np.float32(1.0)
        disturbed *= seen
        np.maximum(disturbed, np.float32(0.0), out=disturbed)
        disturbed[lost] = np.inf
        return disturbed

    def _laid(self, shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float32]:
        height, width = shape
        wanted = (height + _SPARE_PX, width + _SPARE_PX)
        if self._tile is None or self._tile.shape != wanted:
            self._tile = rng.standard_normal(wanted, dtype=np.float32)
        row, column = rng.integers(0, _SPARE_PX, 2).tolist()
        return self._tile[row : row + height, column : column + width]
