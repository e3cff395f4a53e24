"""Recorded images: a video file, or a folder of image files."""

import re
from collections.abc import Callable, Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any

import av

from wil_campaign.foundation.files.images import ImageError, check_image_size, read_image_bytes
from wil_campaign.foundation.files.lfs import LFS_POINTER, is_lfs_file
from wil_campaign.foundation.files.limits import MAX_IMAGE_PIXELS
from wil_campaign.foundation.files.paths import is_file
from wil_campaign.plugins.cameras.av_input import EXPLODE, grey_bits_fault, opening_error
from wil_campaign.plugins.cameras.camera_images import decode_camera_image
from wil_campaign.plugins.cameras.recorded_camera import RecordedImage
from wil_campaign.vehicles.sources.camera_source import IMAGE_SUFFIXES, SourceError

_LENGTHS: Mapping[str, Callable[[Any], int | None]] = {
    "avi": lambda stream: stream.frames,  # of one tick each; FFmpeg shortens its duration
    "mov,mp4,m4a,3gp,3g2,mj2": lambda stream: stream.duration,
}
"""What a format's header states of a stream's length, in its ticks; of others it is a guess."""


class VideoFile:
    """The images of a video file, by their own time stamps; an ImageFile."""

    def __init__(self, *, path: Path) -> None:
        self._path = path
        self._container: Any = None
        self._frames: Any = None
        self._first_s: float | None = None
        self._last_s = self._longest_s = self._stated_s = 0.0
        self._images = self._stated_images = 0

    @property
    def name(self) -> str:
        """Return the video file's path."""
        return str(self._path)

    def open(self) -> None:
        """Open the video file. Raises SourceError."""
        try:
            # A playlist or a session description would make FFmpeg open other files and addresses.
            options = {"protocol_whitelist": "file"}
            self._container = av.open(str(self._path), options=options)
        except (av.error.FFmpegError, OSError, ValueError) as error:
            if is_file(self._path) and is_lfs_file(self._path):
                raise SourceError(f"{self.name}: {LFS_POINTER}") from error
            raise opening_error(self.name, error) from error
        if not self._container.streams.video:
            raise SourceError(f"{self.name}: has no video; is it audio only?")
        stream = self._container.streams.video[0]
        if stream.codec_context is None:
            raise SourceError(f"{self.name}: FFmpeg has no decoder for this video")
        # One thread: some decoders conceal errors per thread, so that images depend on the machine.
        stream.codec_context.thread_count = 1
        self._check_size(stream.codec_context.width, stream.codec_context.height)
        # A damaged JPEG would show the image before in a part of it.
        strict = EXPLODE if stream.codec_context.name == "mjpeg" else {}
        stream.codec_context.options = {"max_pixels": str(MAX_IMAGE_PIXELS), **strict}
        self._stated_s = _stated_end_s(stream.metadata.get("DURATION", ""))
        ticks = _LENGTHS.get(self._container.format.name, lambda _: 0)(stream) or 0
        if ticks:
            self._stated_s = float(((stream.start_time or 0) + ticks) * stream.time_base)
            self._stated_images = stream.frames
        self._frames = self._container.decode(stream)

    def next(self) -> RecordedImage | None:
        """Return the video file's next image. Raises SourceError for a broken file."""
        try:
            frame = next(self._frames, None)
        except av.error.FFmpegError as error:
            raise SourceError(f"{self.name}: the file is damaged: {error.strerror}") from error
        if frame is None:
            self._check_end()
            return None
        self._check_frame(frame)
        if self._first_s is None:
            self._first_s = self._last_s = frame.time
        self._longest_s = max(self._longest_s, frame.time - self._last_s)
        self._last_s = frame.time
        self._images += 1
        return RecordedImage(frame.time - self._first_s, frame.to_ndarray(format="bgr24"))

    def close(self) -> None:
        """Close the video file."""
        if self._container is not None:
            self._container.close()

    def _check_end(self) -> None:
        """Raise SourceError where images are missing at the end.

        FFmpeg tells of Matroska nothing, nor where each image is coded alone (MJPEG). The last
        image may be shown as long as any other one, and once more for rounding; longer where none
        is missing by their number.
        """
        if self._images >= self._stated_images > 0:
            return
        if self._longest_s and self._last_s + 2.0 * self._longest_s < self._stated_s:
            raise SourceError(
                f"{self.name}: the file is cut off: its last image is at {self._last_s:.3f} s, and "
                f"it states {self._stated_s:.3f} s; copy it again, or cut it there"
            )

    def _check_size(self, width_px: int, height_px: int) -> None:
        try:
            check_image_size(width_px, height_px)
        except ImageError as error:
            raise SourceError(f"{self.name}: cannot be decoded: {error}") from error

    def _check_frame(self, frame: Any) -> None:
        self._check_size(frame.width, frame.height)
        if frame.is_corrupt:
            raise SourceError(
                f"{self.name}: the file is damaged at {frame.time} s; copy it again, or cut it "
                "before that"
            )
        if why := grey_bits_fault(frame.format):
            raise SourceError(f"{self.name}: {why}")
        if frame.time is None:
            raise SourceError(
                f"{self.name}: its images have no time stamps; remux it: "
                "ffmpeg -r RATE -i IN -c copy OUT.mp4"
            )
        if frame.rotation:
            raise SourceError(
                f"{self.name}: the video is marked as rotated by {frame.rotation} degrees, as "
                "phones do; convert it upright: ffmpeg -i IN OUT.mp4"
            )


def _stated_end_s(written: str) -> float:
    """Return the end of a video's images as Matroska states it ("00:01:02.5"); 0 if it does not."""
    match = re.fullmatch(r"(\d+):(\d+):(\d+(?:\.\d*)?)", written.strip("\0 "))
    return 0.0 if match is None else 3600 * int(match[1]) + 60 * int(match[2]) + float(match[3])


class ImageFolder:
    """The image files of a folder in the order of their names, at a rate; an ImageFile.

    Numbers in names count as numbers: `9.png` comes before `10.png`, and of seconds since 1970
    (ten digits) `1700000000.25.png` before `1700000000.5.png`.
    """

    def __init__(self, *, path: Path, rate_hz: float) -> None:
        if not 0.0 < rate_hz < 1e4:
            raise SourceError(f"{path}: the rate is {rate_hz} Hz; it must be positive")
        self._path = path
        self._rate_hz = rate_hz
        self._images: list[Path] = []
        self._index = 0

    @property
    def name(self) -> str:
        """Return the image folder's path."""
        return str(self._path)

    def open(self) -> None:
        """List the folder's image files. Raises SourceError."""
        try:
            entries = list(self._path.iterdir())
        except OSError as error:
            raise SourceError(f"{self.name}: {error.strerror}; name a folder of images") from error
        images = [entry for entry in entries if entry.suffix.lower() in IMAGE_SUFFIXES]
        if not images:
            kinds = ", ".join(sorted(IMAGE_SUFFIXES))
            raise SourceError(f"{self.name}: the folder has no image ({kinds})")
        self._images = sorted(images, key=lambda image: _natural_key(image.name))

    def next(self) -> RecordedImage | None:
        """Return the next image file. Raises SourceError for one that cannot be read."""
        if self._index >= len(self._images):
            return None
        path, offset_s = self._images[self._index], self._index / self._rate_hz
        self._index += 1
        try:
            image_bgr = decode_camera_image(str(path), read_image_bytes(path))
        except (ImageError, OSError) as error:
            raise SourceError(
                f"{path}: cannot be read as an image; remove it from the folder: {error}"
            ) from error
        return RecordedImage(offset_s, image_bgr)

    def close(self) -> None:
        """Forget the list of image files."""
        self._images = []


def _natural_key(name: str) -> tuple[tuple[int, Decimal, str], ...]:
    """Return the sort key of an image file's name: numbers by value."""
    parts = re.findall(r"(?<!\d)\d{10}\.\d+|\d+|\D+", name)
    return tuple(
        (0, Decimal(part), part) if part[0].isdecimal() else (1, Decimal(0), part) for part in parts
    )
