"""Cameras by their address: live ones, and recordings."""

from pathlib import Path
from typing import Literal

from wil_campaign.campaigns.values.external_setups import SourceSetup
from wil_campaign.foundation.files.problems import without_passwords
from wil_campaign.plugins.cameras.av_grabber import AvGrabber
from wil_campaign.plugins.cameras.av_input import av_input
from wil_campaign.plugins.cameras.image_files import ImageFolder, VideoFile
from wil_campaign.plugins.cameras.live_camera import LiveCamera
from wil_campaign.plugins.cameras.mcap_images import McapFile
from wil_campaign.plugins.cameras.recorded_camera import ImageFile, RecordedCamera
from wil_campaign.vehicles.readings import Source
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.worlds.camera import Intrinsics


def live_source(
    setup: SourceSetup, *, intrinsics: Intrinsics, side: Source, rate_hz: float
) -> LiveCamera:
    """Return the live camera of a campaign. Raises SourceError."""
    return live_camera(
        setup.address,
        intrinsics=intrinsics,
        side=side,
        latency_s=setup.latency_s,
        rate_hz=rate_hz,
        open_timeout_s=setup.open_s,
        stall_timeout_s=setup.stall_s,
        rtsp_transport=setup.transport,
        v4l2_format=setup.device_format,
    )


def recording(
    setup: SourceSetup, *, intrinsics: Intrinsics, side: Source, rate_hz: float
) -> RecordedCamera:
    """Return the recorded camera of a campaign."""
    return RecordedCamera(
        file=_image_file(setup, rate_hz),
        intrinsics=intrinsics,
        side=side,
        latency_s=setup.latency_s,
    )


def _image_file(setup: SourceSetup, rate_hz: float) -> ImageFile:
    path = Path(setup.address)
    if setup.kind == "images":
        return ImageFolder(path=path, rate_hz=rate_hz)
    if setup.kind == "mcap":
        return McapFile(path=path, topic=setup.topic)
    return VideoFile(path=path)


def live_camera(
    address: str,
    *,
    intrinsics: Intrinsics,
    side: Source = "real",
    latency_s: float = 0.0,
    rate_hz: float | None = None,
    open_timeout_s: float = 5.0,
    stall_timeout_s: float = 2.0,
    rtsp_transport: Literal["tcp", "udp"] = "tcp",
    v4l2_format: str | None = None,
) -> LiveCamera:
    """Return the camera behind `rtsp://...`, `rtp://HOST:PORT`, `*.sdp` or `/dev/video*`.

    latency_s: middle of the exposure to arrival of the quickest image (`wil-campaign calibrate`).
    rate_hz: requested of a V4L2 device, and used to count exposures that never arrived; None when
    the rate varies. Wall clock only. Raises SourceError for another address.
    """
    source = av_input(
        address,
        intrinsics=intrinsics,
        rate_hz=rate_hz,
        rtsp_transport=rtsp_transport,
        v4l2_format=v4l2_format,
    )
    if source.kind == "file":
        raise SourceError(
            f"{without_passwords(address)}: is not a live camera; live cameras are rtsp://..., "
            "rtp://HOST:PORT, "
            "FILE.sdp and /dev/videoN; a video file is a recording"
        )
    return LiveCamera(
        name=without_passwords(address),
        grabber=AvGrabber(
            source=source, open_timeout_s=open_timeout_s, stall_timeout_s=stall_timeout_s
        ),
        intrinsics=intrinsics,
        side=side,
        latency_s=latency_s,
        rate_hz=rate_hz,
        open_timeout_s=open_timeout_s,
        stall_timeout_s=stall_timeout_s,
    )
