"""MAVLink 2 signing: signs and verifies frames as bytes, without decoding their messages; pure.

https://mavlink.io/en/guide/message_signing.html: a signed frame has bit 0 of its incompatibility
flags set and ends with a link id, a timestamp of 48 bits and 48 bits of a SHA-256. The checksum
covers that bit. It is linear (a CRC): setting the bit changes it by a value that depends only on
the frame's length. So a frame can be signed, or its signature removed, without the extra byte of
its message.
"""

from dataclasses import dataclass
from functools import cache

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.signed_links.signing_key import SigningKey
from wil_campaign.vehicles.mavlink.framing import MavlinkFrame

SIGNATURE_BYTES = 13
TICKS_PER_S = 100_000
"""Timestamps count 10 us since 2015-01-01 UTC."""
_UTC_OF_ZERO_S = 1_420_070_400
_OLDEST_NEW_STREAM = 60 * TICKS_PER_S
"""A new stream may be at most a minute behind our time."""
_MOST_TICKS = 2**48 - 1
_SIGNED = 0x01
_UNSIGNED_ACCEPTED = frozenset({mavlink.MAVLINK_MSG_ID_RADIO_STATUS})
"""Radios have no key: the guide accepts their status unsigned."""


def ticks_of_utc(utc_s: float) -> int:
    """Return the signing timestamp of a moment in seconds since 1970 (UTC)."""
    return min(max(0, round((utc_s - _UTC_OF_ZERO_S) * TICKS_PER_S)), _MOST_TICKS)


@dataclass(frozen=True, slots=True)
class SigningCounts:
    """The counts of signed frames by outcome.

    unsigned: not signed, or MAVLink 1, and refused. bad: signed with another key, or altered.
    replayed: not newer than the last of their stream, or more than a minute old. unsignable:
    outgoing frames in MAVLink 1, not sent.
    """

    signed: int = 0
    accepted: int = 0
    unsigned: int = 0
    bad: int = 0
    replayed: int = 0
    unsignable: int = 0

    def __str__(self) -> str:
        refused = {
            "unsigned": self.unsigned,
            "with a wrong signature": self.bad,
            "replayed or out of date": self.replayed,
        }
        return ", ".join(f"{count} {name}" for name, count in refused.items() if count)


class Signer:
    """Signs outgoing and verifies incoming frames, with one key on one link.

    Times are timestamps (`ticks_of_utc`). A received timestamp that is later than ours advances
    ours, as the guide requires, so that a vehicle whose clock is ahead accepts our frames.
    """

    def __init__(self, *, key: SigningKey, link_id: int = 0, newest: int = 0) -> None:
        if not 0 <= link_id <= 255:
            raise ValueError(f"link_id is {link_id}: it must be 0 to 255")
        self._key = key
        self._link_id = link_id
        self._newest = newest
        self._streams: dict[tuple[int, int, int], int] = {}
        self._signed = 0
        self._accepted = 0
        self._unsigned = 0
        self._bad = 0
        self._replayed = 0
        self._unsignable = 0

    @property
    def counts(self) -> SigningCounts:
        """Return the signing counts of frames."""
        return SigningCounts(
            self._signed,
            self._accepted,
            self._unsigned,
            self._bad,
            self._replayed,
            self._unsignable,
        )

    @property
    def newest(self) -> int:
        """Return the last signing timestamp used: the next signer starts from it."""
        return self._newest

    def sign(self, frame: MavlinkFrame, now: int) -> bytes | None:
        """Return a frame with our signature; None for MAVLink 1, which cannot be signed."""
        if frame.version != 2:
            self._unsignable += 1
            return None
        # Timestamps increase by at least one per frame: equal ones would count as a replay.
        self._newest = stamp = min(max(now, self._newest + 1), _MOST_TICKS)
        self._signed += 1
        body = _set_flag(_bare(frame), signed=True)
        covered = body + bytes([self._link_id]) + stamp.to_bytes(6, "little")
        return covered + self._key.signature(covered)

    def check(self, frame: MavlinkFrame, now: int) -> bytes | None:
        """Return a frame without its signature; None when the signature is refused."""
        if not frame.signed:
            if frame.message_id in _UNSIGNED_ACCEPTED:
                return frame.raw
            self._unsigned += 1
            return None
        covered, signature = frame.raw[:-6], frame.raw[-6:]
        if not self._key.signed(covered, signature):
            self._bad += 1
            return None
        link_id, stamp = covered[-7], int.from_bytes(covered[-6:], "little")
        if not self._is_new((frame.system, frame.component, link_id), stamp, now):
            self._replayed += 1
            return None
        self._accepted += 1
        return _set_flag(_bare(frame), signed=False)

    def _is_new(self, stream: tuple[int, int, int], stamp: int, now: int) -> bool:
        ours = max(now, self._newest)
        last = self._streams.get(stream)
        if stamp <= last if last is not None else stamp < ours - _OLDEST_NEW_STREAM:
            return False
        self._streams[stream] = stamp
        self._newest = max(self._newest, stamp)
        return True


def _bare(frame: MavlinkFrame) -> bytes:
    """Return a signed frame's bytes without the signature."""
    return frame.raw[:-SIGNATURE_BYTES] if frame.signed else frame.raw


def _set_flag(raw: bytes, *, signed: bool) -> bytes:
    """Return a frame without a signature, with its signing flag and checksum updated."""
    if bool(raw[2] & _SIGNED) == signed:
        return raw
    crc = (raw[-2] | raw[-1] << 8) ^ _flag_in_checksum(len(raw))
    return raw[:2] + bytes([raw[2] ^ _SIGNED]) + raw[3:-2] + crc.to_bytes(2, "little")


@cache
def _flag_in_checksum(length: int) -> int:
    """Return how the signing flag changes the checksum of a frame of `length` bytes.

    The register (CRC-16/MCRF4XX) starts at 0, as its initial value cancels out; after the flag
    follow the rest of the frame without checksum, and the message's extra byte.
    """
    crc = 0
    # The magic byte is not covered; the length before the flag changes nothing.
    for byte in (_SIGNED, *(0,) * (length - 5 + 1)):
        value = byte ^ (crc & 0xFF)
        value = (value ^ (value << 4)) & 0xFF
        crc = (crc >> 8) ^ (value << 8) ^ (value << 3) ^ (value >> 4)
    return crc & 0xFFFF
