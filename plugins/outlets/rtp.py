"""Delivers images as H.264 by RTP over UDP, and writes the SDP file for players."""

from pathlib import Path
from typing import Any

import av

from wil_campaign.foundation.files.document_writer import write_atomically
from wil_campaign.plugins.outlets.h264_encoder import RTP_CLOCK, H264Settings, to_h264_frame
from wil_campaign.plugins.outlets.image_delivery import DeliveryError
from wil_campaign.plugins.outlets.sdp import RtpAddress, h264_sdp
from wil_campaign.plugins.outlets.threaded_delivery import ThreadedDelivery
from wil_campaign.vehicles.readings import CameraReading

_PACKET_BYTES = 1316
"""Fits every network's packets, tunnels included."""


class RtpSink:
    """Sends H.264 by RTP; a Sink. Images of another size than the stream's are not sent."""

    def __init__(
        self,
        *,
        address: RtpAddress,
        width_px: int,
        height_px: int,
        settings: H264Settings,
        sdp_path: Path | None,
    ) -> None:
        self.name = str(address)
        self._address = address
        self._size = (width_px, height_px)
        self._settings = settings
        self._sdp_path = sdp_path
        self._container: Any = None
        self._stream: Any = None
        self._start_s: float | None = None
        self._last_pts = -1

    def open(self) -> None:
        """Write the SDP file and open the RTP socket. Raises DeliveryError."""
        width, height = self._size[0] & ~1, self._size[1] & ~1
        try:
            self._write_sdp(width, height)
            self._container = av.open(
                f"{self._address}?pkt_size={_PACKET_BYTES}",
                "w",
                format="rtp",
                options={"cname": "wil-campaign"},
            )
            self._stream = self._container.add_stream("libx264", rate=self._settings.rate)
            self._stream.time_base = RTP_CLOCK
            self._settings.configure(self._stream.codec_context, width, height)
            # Otherwise the host name would be resolved with the first image.
            self._container.start_encoding()
        except (av.error.FFmpegError, OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise DeliveryError(
                f"{self.name}: cannot open: {reason}; check the host name and the network"
            ) from error

    def write(self, reading: CameraReading) -> None:
        """Send one image by RTP, stamped with its exposure. Raises DeliveryError."""
        height, width = reading.image_bgr.shape[:2]
        if (width, height) != self._size:
            raise DeliveryError(
                f"{self.name}: image not sent: its size {width}x{height} does not fit the stream "
                f"of {self._size[0]}x{self._size[1]}"
            )
        if self._start_s is None:
            self._start_s = reading.t_s
        pts = round((reading.t_s - self._start_s) / RTP_CLOCK)
        if pts <= self._last_pts:
            raise DeliveryError(
                f"{self.name}: image {reading.seq} not sent: it is not newer than the previous one"
            )
        self._last_pts = pts
        try:
            self._container.mux(self._stream.encode(to_h264_frame(reading.image_bgr, pts)))
        except (av.error.FFmpegError, OSError) as error:
            raise DeliveryError(f"{self.name}: image not sent: {error}") from error

    def close(self) -> None:
        """Close the RTP socket."""
        if self._container is not None:
            self._container.close()

    def _write_sdp(self, width: int, height: int) -> None:
        if self._sdp_path is None:
            return
        sets = self._settings.parameter_sets(width, height)
        sdp = h264_sdp(self._address, parameter_sets=sets, rate_hz=float(self._settings.rate))
        write_atomically(self._sdp_path, sdp)


def rtp_delivery(
    *,
    width_px: int,
    height_px: int,
    rate_hz: float,
    address: RtpAddress | None = None,
    sdp_path: Path | None = None,
    key_interval_s: float = 1.0,
    quality_crf: int = 20,
    max_bit_rate: int | None = None,
) -> ThreadedDelivery:
    """Return a delivery by RTP; by default to 127.0.0.1:5600, where ground stations listen.

    width_px, height_px: of all images; odd sides lose their last row or column. rate_hz:
    approximate rate of images. sdp_path: SDP file for players that need one.
    """
    settings = H264Settings(
        rate_hz=rate_hz,
        key_interval_s=key_interval_s,
        quality_crf=quality_crf,
        max_bit_rate=max_bit_rate,
    )
    sink = RtpSink(
        address=address or RtpAddress(),
        width_px=width_px,
        height_px=height_px,
        settings=settings,
        sdp_path=sdp_path,
    )
    return ThreadedDelivery(sink=sink)
