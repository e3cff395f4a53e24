"""The session description of an H.264 stream over RTP; pure.

RFC 8866 (SDP), RFC 6184 (H.264 over RTP: packetization-mode, profile-level-id,
sprop-parameter-sets).
"""

import base64
import re
from dataclasses import dataclass
from typing import Self

_HOST_PORT = re.compile(r"([^:/\s]+|\[[0-9A-Fa-f:.]+\]):(\d{1,5})")


@dataclass(frozen=True, slots=True)
class RtpAddress:
    """The stream's address in SDP: host or multicast group, UDP port of RTP (RTCP: + 1)."""

    host: str = "127.0.0.1"
    port: int = 5600

    @classmethod
    def of(cls, text: str) -> Self:
        """Return the address in HOST:PORT. Raises ValueError for a wrong or odd port."""
        match = _HOST_PORT.fullmatch(text)
        if match is None or not 0 < int(match[2]) < 65535:
            raise ValueError(f"{text!r} must be HOST:PORT, as in 127.0.0.1:5600")
        if int(match[2]) % 2:
            raise ValueError(f"{text!r}: RTP needs an even port; the next one is for RTCP")
        return cls(match[1], int(match[2]))

    def __str__(self) -> str:
        return f"rtp://{self.host}:{self.port}"


def h264_sdp(address: RtpAddress, *, parameter_sets: tuple[bytes, ...], rate_hz: float) -> str:
    """Return the SDP of an H.264 stream with payload type 96 and a clock of 90 kHz.

    parameter_sets: the stream's SPS and PPS without start codes, so that a receiver knows the
    size before the first key frame. Raises ValueError when the first one is no SPS.
    """
    sps = parameter_sets[0] if parameter_sets else b""
    if len(sps) < 4 or sps[0] & 0x1F != 7:
        raise ValueError("the first parameter set is not an H.264 SPS")
    family = "IP6" if ":" in address.host else "IP4"
    sprop = ",".join(base64.b64encode(each).decode() for each in parameter_sets)
    level = f"packetization-mode=1;profile-level-id={sps[1:4].hex()}"
    lines = (
        "v=0",
        f"o=- 0 0 IN {family} {address.host}",
        "s=wil mixed pictures",
        f"c=IN {family} {address.host}",
        "t=0 0",
        f"m=video {address.port} RTP/AVP 96",
        "a=rtpmap:96 H264/90000",
        f"a=fmtp:96 {level};sprop-parameter-sets={sprop}",
        f"a=framerate:{rate_hz:g}",
        "a=recvonly",
    )
    return "\r\n".join(lines) + "\r\n"


def split_parameter_sets(extradata: bytes) -> tuple[bytes, ...]:
    """Return SPS and PPS of an encoder's header (Annex B) for the SDP."""
    units = extradata.replace(b"\x00\x00\x00\x01", b"\x00\x00\x01").split(b"\x00\x00\x01")
    return tuple(unit for unit in units if unit and unit[0] & 0x1F in {7, 8})
