"""Camera readings from files: images, videos, depth files, and rendered worlds."""

import math
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.foundation.files.images import ImageError, decode_image_file, read_image_bytes
from wil_campaign.foundation.files.limits import MAX_IMAGE_PIXELS
from wil_campaign.foundation.files.paths import is_file, is_folder
from wil_campaign.plugins.cameras.camera_images import require_8_bits
from wil_campaign.plugins.cameras.frame_stamps import checked_frame
from wil_campaign.plugins.cameras.image_files import VideoFile
from wil_campaign.plugins.cameras.recorded_camera import ImageFile, RecordedImage
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.vehicles.readings import BgrImage, CameraReading, DepthImage, Source
from wil_campaign.vehicles.sources.camera_source import IMAGE_SUFFIXES, SourceError
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.render.renderer import Renderer
from wil_campaign.worlds.world_file.world import World

InputKind = Literal["image", "video", "recording", "world"]

_MM_PER_M = 1000.0
_LARGEST_DEPTH_BYTES = 8 * MAX_IMAGE_PIXELS + 4096


def input_kind_of(path: Path) -> InputKind:
    """Return the kind of an input by its name: image, world or recording, else a video."""
    suffix = path.suffix.lower()
    if is_folder(path) or suffix == ".mcap":
        return "recording"
    if suffix in IMAGE_SUFFIXES:
        return "image"
    return "world" if suffix in (".yaml", ".yml") else "video"


@dataclass(frozen=True, slots=True)
class InputFileOptics:
    """The optics of image files' camera. fov_deg: horizontal, edge to edge."""

    fov_deg: float

    def of(self, image_bgr: BgrImage) -> Intrinsics:
        """Return the camera model of an image file's size."""
        height_px, width_px = image_bgr.shape[:2]
        return Intrinsics.from_fov(width_px, height_px, math.radians(self.fov_deg))


def read_image_reading(path: Path, side: Source, optics: InputFileOptics) -> CameraReading:
    """Return an image file as a reading at time 0. Raises OfflineError."""
    if not is_file(path):
        raise OfflineError(f"{path}: there is no such file")
    found = _read(path, cv2.IMREAD_COLOR)
    return _reading_of(checked_frame(str(path), found), 0, 0.0, side, optics)


def _read(path: Path, flags: int) -> NDArray[Any]:
    try:
        data = read_image_bytes(path)
        image = decode_image_file(data, flags)
        if flags == cv2.IMREAD_COLOR:
            require_8_bits(data)
    except (ImageError, OSError) as error:
        raise OfflineError(f"{path}: cannot be read as an image: {error}") from error
    return image


def read_video_readings(
    path: Path, side: Source, optics: InputFileOptics
) -> Iterator[CameraReading]:
    """Yield the images of a video file at their times. Raises OfflineError."""
    for seq, still in enumerate(still_images(VideoFile(path=path))):
        yield _reading_of(still.image_bgr, seq, still.offset_s, side, optics)


def still_images(file: ImageFile) -> Iterator[RecordedImage]:
    """Yield the images of a video, a folder or an MCAP file. Raises OfflineError."""
    try:
        with closing(file):
            file.open()
            while (still := file.next()) is not None:
                yield still
    except SourceError as error:
        raise OfflineError(str(error)) from error


def _reading_of(
    image_bgr: BgrImage, seq: int, t_s: float, side: Source, optics: InputFileOptics
) -> CameraReading:
    return CameraReading(
        t_s=t_s,
        arrived_s=t_s,
        seq=seq,
        source=side,
        image_bgr=image_bgr,
        intrinsics=optics.of(image_bgr),
        rendered=False,
    )


def read_depth_file(path: Path) -> DepthImage:
    """Return a depth file: .npy in metres, or a 16-bit image in millimetres, 0 for unknown.

    Unknown depth is infinite. Raises OfflineError.
    """
    if not is_file(path):
        raise OfflineError(f"{path}: there is no such file")
    if path.stat().st_size > _LARGEST_DEPTH_BYTES:
        raise OfflineError(f"{path}: is larger than {_LARGEST_DEPTH_BYTES} bytes")
    if path.suffix.lower() == ".npy":
        try:
            # Mapped: a header that claims more than the file has allocates nothing.
            metres = np.array(np.load(path, mmap_mode="r", allow_pickle=False))
        except (OSError, ValueError, EOFError) as error:
            raise OfflineError(f"{path}: cannot be read as an array: {error}") from error
    else:
        found = _read(path, cv2.IMREAD_UNCHANGED)
        if found.dtype != np.uint16:
            raise OfflineError(
                f"{path}: is not a 16-bit image; depth is a 16-bit image in millimetres, or .npy"
            )
        metres = np.where(found == 0, np.inf, found / _MM_PER_M)
    if metres.ndim != 2 or metres.dtype.kind != "f":
        raise OfflineError(
            f"{path}: depth must be (height, width) of floats, this is {metres.shape} of "
            f"{metres.dtype}"
        )
    found_m: DepthImage = metres.astype(np.float32)
    return found_m


def reading_with_depth(reading: CameraReading, depth_m: DepthImage, path: Path) -> CameraReading:
    """Return an image reading with depth. Raises OfflineError when the sizes differ."""
    size, wanted = depth_m.shape, reading.image_bgr.shape[:2]
    if size != wanted:
        raise OfflineError(
            f"{path}: depth of {size[1]}x{size[0]} for an image of {wanted[1]}x{wanted[0]}"
        )
    return replace(reading, depth_m=depth_m)


class WorldCamera:
    """Renders the virtual objects of a world for each real image, from one pose."""

    def __init__(self, *, world: World, pose: Pose, optics: InputFileOptics) -> None:
        self._renderer = Renderer(world.scene("wil", "Wv"))
        self._pose = pose
        self._optics = optics

    def reading(self, real: CameraReading) -> CameraReading:
        """Return the rendered image with depth and ids, at the size and time of a real one."""
        lens = self._optics.of(real.image_bgr)
        seen = self._renderer.render(
            self._pose, lens, real.t_s, {"goal": 0.0}, want_depth=True, want_ids=True
        )
        return CameraReading(
            t_s=real.t_s,
            arrived_s=real.arrived_s,
            seq=real.seq,
            source="twin",
            image_bgr=seen.image_bgr,
            intrinsics=lens,
            depth_m=seen.depth_m,
            object_ids=seen.object_ids,
            camera_pose=self._pose,
        )
