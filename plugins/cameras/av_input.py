"""FFmpeg inputs of camera addresses, their options, and FFmpeg's errors as messages."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import av

from wil_campaign.foundation.files.problems import without_passwords
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.worlds.camera import Intrinsics

AvKind = Literal["rtsp", "rtp", "v4l2", "file"]

_LOW_DELAY: Mapping[str, str] = {
    # Probing waits for the first frame's data only: latency gained while probing stays for good.
    "probesize": "32",
    "analyzeduration": "0",
    "flags": "low_delay",
}
_NETWORK: Mapping[str, str] = {
    **_LOW_DELAY,
    # A reorder queue delays all packets while it waits for a lost one, and takes the sequence
    # numbers of a restarted sender for old ones. Packets out of order count as lost.
    "reorder_queue_size": "0",
    # For a thread that cannot read at once; the kernel grants at most net.core.rmem_max.
    "buffer_size": "4194304",
}

EXPLODE: Mapping[str, str] = {"err_detect": "explode"}
"""Of MJPEG alone: a damaged image is an error then. Damaged notes beside the pixels are none."""


@dataclass(frozen=True, slots=True)
class AvInput:
    """The input that `av.open` is called with. sdp: the session's text for the address."""

    kind: AvKind
    url: str
    format: str | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    sdp: str | None = None

    def session(self) -> str | None:
        """Return the input's SDP text, from its file if it has one. Raises SourceError."""
        if self.sdp is None and self.format == "sdp":
            return _read_sdp(self.url)
        return self.sdp


def av_input(
    address: str,
    *,
    intrinsics: Intrinsics | None = None,
    rate_hz: float | None = None,
    rtsp_transport: Literal["tcp", "udp"] = "tcp",
    v4l2_format: str | None = None,
) -> AvInput:
    """Return PyAV's input for `rtsp://...`, `rtp://HOST:PORT`, `*.sdp`, `/dev/video*`, files.

    `rtp://` takes H.264 with dynamic payload type 96, as sent by `deliver`, by
    GStreamer's rtph264pay and by most drones; anything else is described by an SDP file.
    intrinsics, rate_hz, v4l2_format: requested of a V4L2 device. Raises SourceError.
    """
    if address.startswith(("rtsp://", "rtsps://")):
        return AvInput("rtsp", address, None, {**_NETWORK, "rtsp_transport": rtsp_transport})
    if address.startswith("rtp://"):
        return _rtp(address, _default_sdp(address))
    if address.endswith(".sdp"):
        return _rtp(address, None)
    device = address.removeprefix("v4l2://")
    if device.startswith("/dev/"):
        return AvInput("v4l2", device, "v4l2", _v4l2_options(intrinsics, rate_hz, v4l2_format))
    return AvInput("file", address)


def _rtp(address: str, sdp: str | None) -> AvInput:
    return AvInput("rtp", address, "sdp", {**_NETWORK, "protocol_whitelist": "file,udp,rtp"}, sdp)


def _default_sdp(address: str) -> str:
    """Return the SDP of an RTP address with H.264. Raises SourceError."""
    match = re.fullmatch(r"rtp://([^:/@]+):(\d{1,5})/?", address)
    if match is None or not 0 < int(match[2]) < 65536:
        raise SourceError(f"{address}: is not rtp://HOST:PORT, as in rtp://127.0.0.1:5600")
    lines = (
        "v=0",
        f"o=- 0 0 IN IP4 {match[1]}",
        "s=video",
        f"c=IN IP4 {match[1]}",
        "t=0 0",
        f"m=video {match[2]} RTP/AVP 96",
        "a=rtpmap:96 H264/90000",
        "a=fmtp:96 packetization-mode=1",
    )
    return "\r\n".join(lines) + "\r\n"


def _read_sdp(path: str) -> str:
    """Return the text of an input's SDP file. Raises SourceError."""
    try:
        return Path(path).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise SourceError(
            f"{path}: the session description cannot be read: {reason}; the sender of the stream "
            "writes this file"
        ) from error


def _v4l2_options(
    intrinsics: Intrinsics | None, rate_hz: float | None, v4l2_format: str | None
) -> dict[str, str]:
    """Return PyAV's options for a V4L2 input: size, rate, format."""
    options: dict[str, str] = {}
    if intrinsics is not None:
        options["video_size"] = f"{intrinsics.width_px}x{intrinsics.height_px}"
    if rate_hz is not None:
        options["framerate"] = f"{rate_hz:g}"
    if v4l2_format is not None:
        options["input_format"] = v4l2_format
    return options


_REMEDIES: tuple[tuple[type[Exception], str], ...] = (
    (FileNotFoundError, "there is no such file or device; check the path"),
    (PermissionError, "no permission; for a camera, join the group `video` and log in again"),
    (
        ConnectionRefusedError,
        "nothing listens there; start the camera or its server, and check host and port",
    ),
    (TimeoutError, "no answer in time; check host, port and network"),
    (av.error.InvalidDataError, "is not video that can be decoded; check it with ffplay"),
    (av.error.HTTPUnauthorizedError, "asks for a user and password: rtsp://USER:PASSWORD@HOST/..."),
    (av.error.HTTPForbiddenError, "refuses this user; check user and password"),
    (av.error.HTTPNotFoundError, "has no such stream; check the path after the host"),
    (IsADirectoryError, "is a folder; name a file in it, or use it as a folder of images"),
)


def grey_bits_fault(pixels: Any) -> str:
    """Return what is wrong with PyAV's format of grey images beyond 8 bits; "" for all others.

    Their upper 8 bits, which a conversion keeps, are nearly black of a sensor with 12.
    """
    bits = max(component.bits for component in pixels.components)
    if bits <= 8 or len(pixels.components) > 1:
        return ""
    return (
        f"its images are grey with {bits} bits, and a camera's have 8; take another format of the "
        "camera, or scale them to 8 bits by the range of your sensor"
    )


def no_image_error(address: str) -> SourceError:
    """Return the error of a camera input from which no image came in time."""
    sent = ""
    if address.startswith("rtp://"):
        sent = ", as H.264 with payload type 96"
    elif address.endswith(".sdp"):
        sent = ", with the payload type that this file has"
    return SourceError(
        f"{without_passwords(address)}: no image arrived in time; check that it is sent to this "
        f"host and port{sent}"
    )


def no_key_frame_error(address: str) -> SourceError:
    """Return the error of a camera input in which nothing can be decoded."""
    return SourceError(
        f"{without_passwords(address)}: video arrives without a key frame to start decoding from; "
        "have the sender send one every second (keyint, GOP, I-frame interval), with its parameter "
        "sets (GStreamer: rtph264pay config-interval=1), or wait longer"
    )


def all_damaged_error(address: str) -> SourceError:
    """Return the error of a camera input whose images, each coded alone, were all damaged."""
    return SourceError(
        f"{without_passwords(address)}: each of its images arrives damaged or cut off; check the "
        "camera's power, cable and network, or ask it for less (size, rate)"
    )


def opening_error(address: str, error: Exception) -> SourceError:
    """Return FFmpeg's error of opening an input, with what to do."""
    name = without_passwords(address)
    if isinstance(error, av.error.ExitError):
        return no_image_error(address)
    for kind, remedy in _REMEDIES:
        if isinstance(error, kind):
            return SourceError(f"{name}: {remedy}")
    reason = getattr(error, "strerror", None) or str(error)
    if address.startswith("/dev/") and isinstance(error, ValueError):
        return SourceError(
            f"{name}: cannot be opened: {reason}; it may have no such size or `format`: "
            f"`v4l2-ctl -d {name} --list-formats-ext` lists its own"
        )
    busy = "resource busy" in reason.lower() or "address already in use" in reason.lower()
    remedy = "another program uses it; end that program" if busy else "check host, port and path"
    return SourceError(f"{name}: cannot be opened: {reason}; {remedy}")
