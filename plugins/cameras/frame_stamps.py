"""Stamps a camera's images with time and number, and checks their size; pure."""

import math

import numpy as np

from wil_campaign.vehicles.readings import BgrImage, CameraReading, Source
from wil_campaign.vehicles.sources.arrival_clock import ArrivalClock, RestartMeter
from wil_campaign.vehicles.sources.camera_source import ImageChangedError, SourceCounts, SourceError
from wil_campaign.vehicles.sources.readings.live_readings import OLDEST_S
from wil_campaign.worlds.camera import Intrinsics


class FrameStamper:
    """Stamps and numbers one camera's images; refuses those of another size.

    rate_hz: exposures a second, when the camera keeps it; then exposures that never arrived are
    counted by the gaps in the stamps. None: every image that arrives counts one.
    """

    def __init__(
        self,
        *,
        name: str,
        side: Source,
        intrinsics: Intrinsics,
        clock: ArrivalClock | None = None,
        rate_hz: float | None = None,
    ) -> None:
        self._name = name
        self._side: Source = side
        self._intrinsics = intrinsics
        self._clock = clock or ArrivalClock()
        self._rate_hz = rate_hz
        self._seq = -1
        self._last_s: float | None = None
        self._has_stamps = False
        self._skipped = 0
        self.missed = 0
        self.restarts = 0
        self._restart_meter = RestartMeter()

    def skip_exposure(self) -> None:
        """Count an exposure that is not handed on: its number is used up."""
        self._skipped += 1

    def reading(
        self, image_bgr: BgrImage, *, stamp_s: float | None, arrived_s: float
    ) -> CameraReading | None:
        """Return the stamped reading of an image; None for one that is not to be handed on.

        That is one not newer than the last, one that is a second later than the quickest (or its
        stamps are not seconds), one of a sender that begins anew all the time, and one that lost
        its stamp: FFmpeg loses that of the first image after a pause, and by its arrival it would
        be as much too late as the pause was long. stamp_s: on the sender's clock; None or not
        finite without one. Raises ImageChangedError.
        """
        has_stamp = stamp_s is not None and math.isfinite(stamp_s)
        if self._has_stamps and not has_stamp:
            self.skip_exposure()
            return None
        self._has_stamps = has_stamp
        resets = self._clock.resets
        t_s = self._clock.run_time(stamp_s, arrived_s)
        restarted = self._clock.resets != resets
        self.restarts += restarted
        if restarted:
            self._restart_meter.add(arrived_s)
        is_old = arrived_s - t_s > self._clock.latency_s + OLDEST_S
        if is_old or self._restart_meter.fault(arrived_s):
            self.skip_exposure()
            return None
        return self.reading_at(image_bgr, t_s=t_s, arrived_s=arrived_s, restarted=restarted)

    def reading_at(
        self, image_bgr: BgrImage, *, t_s: float, arrived_s: float, restarted: bool = False
    ) -> CameraReading | None:
        """Return the reading of an image whose exposure is known on the run clock.

        restarted: the sender restarted, so that the gap before the image counts no exposures. None
        for an image that is not newer than the last. Raises ImageChangedError.
        """
        check_frame_size(self._name, image_bgr, self._intrinsics)
        if self._last_s is not None and t_s <= self._last_s:
            self._skipped += 1
            return None
        self._seq += self._exposures_since(t_s, restarted=restarted)
        self._last_s, self._skipped = t_s, 0
        return CameraReading(
            t_s=t_s,
            arrived_s=arrived_s,
            seq=self._seq,
            source=self._side,
            image_bgr=image_bgr,
            intrinsics=self._intrinsics,
            rendered=False,
        )

    def _exposures_since(self, t_s: float, *, restarted: bool) -> int:
        known = 1 + self._skipped
        if self._rate_hz is None or self._last_s is None or restarted:
            return known
        by_time = max(known, round((t_s - self._last_s) * self._rate_hz))
        self.missed += by_time - known
        return by_time


def check_frame_size(name: str, image_bgr: BgrImage, intrinsics: Intrinsics) -> None:
    """Raise ImageChangedError unless an image has the intrinsics' size."""
    height, width = image_bgr.shape[:2]
    if (width, height) == (intrinsics.width_px, intrinsics.height_px):
        return
    expected = f"{intrinsics.width_px}x{intrinsics.height_px}"
    raise ImageChangedError(
        f"{name}: the images are {width}x{height}, and the camera's intrinsics are for "
        f"{expected}; set the camera to {expected}, or calibrate it at {width}x{height}"
    )


def checked_frame(name: str, image_bgr: object) -> BgrImage:
    """Return a decoded image as (height, width, 3) uint8. Raises SourceError for any other."""
    if (
        not isinstance(image_bgr, np.ndarray)
        or image_bgr.dtype != np.uint8
        or image_bgr.ndim != 3
        or image_bgr.shape[2] != 3
    ):
        raise SourceError(f"{name}: not an 8-bit colour image")
    return image_bgr


def source_counts(
    stamper: FrameStamper, *, delivered: int, dropped: int = 0, damaged: int = 0
) -> SourceCounts:
    """Return the counts of a source that uses a stamper."""
    return SourceCounts(delivered, dropped, stamper.missed, damaged, stamper.restarts)
