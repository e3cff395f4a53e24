"""RealSense depth cameras by their library, pyrealsense2, which is imported when one is opened.

Written by the library's documented interface; no device was there to try it with.
"""

from importlib import import_module
from typing import Any

import numpy as np

from wil_campaign.plugins.depth_cameras.depth_grabber import (
    GrabbedDepth,
    GrabbedReadings,
    depth_camera_of_request,
)
from wil_campaign.plugins.readings.depth_images import check_depth_camera, metres_of_depths
from wil_campaign.plugins.readings.messagepack import BadMessageError
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.vehicles.sources.source_request import SourceRequest

_SCHEME = "realsense://"
_ANY = "any"
_WAIT_MS = 500
_USUAL_HZ = 30


class RealSense:
    """A DepthGrabber of a RealSense camera, by its serial number or the only one there."""

    def __init__(self, request: SourceRequest) -> None:
        self._address = request.address
        self._serial = request.address.removeprefix(_SCHEME)
        self._rate_hz = round(request.rate_hz or _USUAL_HZ)
        self._camera = depth_camera_of_request(request)
        self._pipeline: Any = None
        self._scale_m = 0.0
        self._last: int | None = None

    def open(self) -> None:
        """Start the depth stream. Raises SourceError."""
        try:
            rs: Any = import_module("pyrealsense2")
        except ImportError as error:
            raise SourceError(
                f"{self._address}: RealSense cameras need the package pyrealsense2, which cannot "
                f"be imported ({error}); install it: pip install pyrealsense2"
            ) from error
        camera, pipeline, config = self._camera, rs.pipeline(), rs.config()
        size = (camera.width_px, camera.height_px)
        if self._serial != _ANY:
            config.enable_device(self._serial)
        config.enable_stream(rs.stream.depth, *size, rs.format.z16, self._rate_hz)
        try:
            profile = pipeline.start(config)
        except RuntimeError as error:
            raise SourceError(
                f"{self._address}: does not start with depth of {size[0]}x{size[1]} at "
                f"{self._rate_hz} Hz: {error}; `rs-enumerate-devices` lists cameras and modes"
            ) from error
        self._pipeline = pipeline
        self._scale_m = float(profile.get_device().first_depth_sensor().get_depth_scale())
        stream = profile.get_stream(rs.stream.depth).as_video_stream_profile()
        lens = stream.get_intrinsics()
        try:
            check_depth_camera(camera, width_px=lens.width, height_px=lens.height, fx_px=lens.fx)
        except BadMessageError as error:
            raise SourceError(f"{self._address}: {error}") from error

    def grab(self) -> GrabbedDepth | None:
        """Return the next depth image; None after a moment without."""
        has_come, frames = self._pipeline.try_wait_for_frames(_WAIT_MS)
        if not has_come or not (frame := frames.get_depth_frame()):
            return None
        number, last = int(frame.get_frame_number()), self._last
        self._last = number
        values = np.asanyarray(frame.get_data())
        size = (self._camera.height_px, self._camera.width_px)
        if values.dtype != np.uint16 or values.shape != size:
            return GrabbedDepth(None, why=f"an image of {values.dtype} {values.shape}, not {size}")
        skipped = 0 if last is None else max(0, number - last - 1)
        stamp_s = float(frame.get_timestamp()) * 1e-3
        return GrabbedDepth(metres_of_depths(values, self._scale_m), stamp_s, skipped)

    def close(self) -> None:
        """Stop the stream."""
        if self._pipeline is not None:
            self._pipeline.stop()


def open_realsense(request: SourceRequest) -> GrabbedReadings:
    """Return the depth images of a RealSense camera."""
    remedy = "the camera is open and sends no image; check its cable, and that USB 3 is used"
    return GrabbedReadings(request=request, grabber=RealSense(request), remedy=remedy)


def realsense_fault(address: str, kind: str) -> str:
    """Return what is wrong with an address, or with a sensor that has it; "" for nothing."""
    if kind != "depth":
        return f"a RealSense camera is a depth sensor here, and the sensor is a {kind}"
    serial = address.removeprefix(_SCHEME)
    if serial != _ANY and not (serial.isascii() and serial.isalnum()):
        return f"'{address}' is not {_SCHEME}SERIAL, or {_SCHEME}{_ANY} for the only one"
    return ""
