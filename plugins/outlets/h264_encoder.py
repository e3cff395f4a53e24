"""H.264 encoder settings for live viewing: no frame waits for another one."""

from fractions import Fraction
from typing import Any

import av
import cv2
import numpy as np

from wil_campaign.plugins.outlets.sdp import split_parameter_sets
from wil_campaign.vehicles.readings import BgrImage

RTP_CLOCK = Fraction(1, 90_000)
_GLOBAL_HEADER = 0x00400000
"""AV_CODEC_FLAG_GLOBAL_HEADER of libavcodec."""


class H264Settings:
    """The H.264 encoder's settings: `ultrafast`, `zerolatency`, parameter sets at each key.

    key_interval_s: longest wait of a late receiver for its first image. quality_crf: x264's
    constant rate factor, 0 (lossless) to 51. max_bit_rate: bits per second, None for no limit.
    """

    def __init__(
        self,
        *,
        rate_hz: float,
        key_interval_s: float = 1.0,
        quality_crf: int = 20,
        max_bit_rate: int | None = None,
    ) -> None:
        self.rate = Fraction(rate_hz).limit_denominator(1000)
        self.options = {
            "preset": "ultrafast",
            "tune": "zerolatency",
            "crf": str(quality_crf),
            "g": str(max(1, round(rate_hz * key_interval_s))),
            # OpenCV's BGR to I420 is BT.601 with limited range: signalled, to keep the colours.
            "x264-params": (
                "repeat-headers=1:sliced-threads=0:scenecut=0:"
                "colormatrix=smpte170m:colorprim=smpte170m:transfer=smpte170m:range=tv"
            ),
        }
        if max_bit_rate is not None:
            # A buffer of a quarter of a second: a larger one is latency on a thin link.
            self.options |= {"maxrate": str(max_bit_rate), "bufsize": str(max_bit_rate // 4)}

    def configure(self, codec: Any, width_px: int, height_px: int) -> None:
        """Set up the H.264 encoder's codec context for an image size."""
        codec.width, codec.height = width_px, height_px
        codec.pix_fmt = "yuv420p"
        codec.time_base = RTP_CLOCK
        codec.framerate = self.rate
        codec.thread_count = 1
        codec.options = dict(self.options)

    def parameter_sets(self, width_px: int, height_px: int) -> tuple[bytes, ...]:
        """Return SPS and PPS of such an H.264 stream, before its first image."""
        codec: Any = av.CodecContext.create("libx264", "w")
        self.configure(codec, width_px, height_px)
        codec.flags |= _GLOBAL_HEADER
        codec.open()
        return split_parameter_sets(bytes(codec.extradata))


def to_h264_frame(image_bgr: BgrImage, pts: int) -> Any:
    """Return an image as a frame for the encoder, cropped to even numbers of pixels."""
    height, width = image_bgr.shape[0] & ~1, image_bgr.shape[1] & ~1
    even = np.ascontiguousarray(image_bgr[:height, :width])
    frame = av.VideoFrame.from_ndarray(cv2.cvtColor(even, cv2.COLOR_BGR2YUV_I420), format="yuv420p")
    frame.pts, frame.time_base = pts, RTP_CLOCK
    return frame
