"""Detects lost H.264 frames by their frame numbers; pure.

A decoder that misses a whole frame continues from the one before without an error: all that
follows looks right and is wrong until the next key frame. Every reference frame carries
frame_num, one more than that of the reference frame before it, modulo a power of two.

ITU-T H.264: 7.3.1 (emulation prevention), 7.3.2.1.1 (sequence parameters), 7.3.3 (slice header),
7.4.3 (frame_num), 9.1 (Exp-Golomb codes), Annex B (start codes).
"""

from collections.abc import Iterator

_SLICE, _IDR, _SPS = 1, 5, 7
_WITH_CHROMA = frozenset({100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135})
_HEADER_BYTES = 64
"""Enough of a unit for all fields that are read, but for scaling lists, which are rare."""


class LossFinder:
    """Finds lost H.264 reference frames in one stream's access units."""

    def __init__(self) -> None:
        self._frame_num_bits: int | None = None
        self._separate_planes = False
        self._previous: int | None = None

    def lost_before(self, access_unit: bytes) -> bool:
        """Return whether an H.264 frame that this one may build on was lost.

        access_unit: a whole frame with start codes (Annex B). False for one that cannot be read.
        """
        for unit in _units(access_unit):
            kind = unit[0] & 0x1F
            try:
                if kind == _SPS:
                    self._take_parameters(unit)
                elif kind in {_SLICE, _IDR}:
                    return self._slice_after_loss(unit, is_key=kind == _IDR)
            except _EndError:
                continue
        return False

    def _take_parameters(self, unit: bytes) -> None:
        bits = _Bits(_unescape(unit[1 : 4 * _HEADER_BYTES]))
        profile = bits.number(8)
        bits.number(16)
        bits.golomb()
        self._separate_planes = False
        if profile in _WITH_CHROMA:
            self._separate_planes = _skip_chroma(bits)
        self._frame_num_bits = bits.golomb() + 4

    def _slice_after_loss(self, unit: bytes, *, is_key: bool) -> bool:
        if self._frame_num_bits is None:
            return False
        bits = _Bits(_unescape(unit[1:_HEADER_BYTES]))
        for _ in range(3):  # first_mb_in_slice, slice_type, pic_parameter_set_id
            bits.golomb()
        if self._separate_planes:
            bits.number(2)
        frame_num = bits.number(self._frame_num_bits)
        previous = self._previous
        if unit[0] & 0x60:  # nal_ref_idc: others may build on this one
            self._previous = frame_num
        if is_key or previous is None:
            return False
        return frame_num not in {previous, (previous + 1) % (1 << self._frame_num_bits)}


class _EndError(Exception):
    """The H.264 data ended within a number."""


class _Bits:
    """The bits of an H.264 unit."""

    def __init__(self, data: bytes) -> None:
        self._value = int.from_bytes(data, "big")
        self._left = 8 * len(data)

    def number(self, count: int) -> int:
        """Return the next bits of the H.264 unit as an unsigned number."""
        if count > self._left:
            raise _EndError
        self._left -= count
        return self._value >> self._left & ((1 << count) - 1)

    def golomb(self) -> int:
        """Return the next unsigned Exp-Golomb code of the H.264 unit."""
        zeros = 0
        while not self.number(1):
            zeros += 1
            if zeros > 32:
                raise _EndError
        return (1 << zeros) - 1 + self.number(zeros)


def _skip_chroma(bits: _Bits) -> bool:
    """Skip H.264's high-profile fields before frame_num; return separate_colour_planes."""
    chroma = bits.golomb()
    separate = chroma == 3 and bits.number(1) == 1
    bits.golomb()
    bits.golomb()
    bits.number(1)
    if bits.number(1):
        for k in range(12 if chroma == 3 else 8):
            if bits.number(1):
                _skip_scaling_list(bits, 16 if k < 6 else 64)
    return separate


def _skip_scaling_list(bits: _Bits, size: int) -> None:
    last, following = 8, 8
    for _ in range(size):
        if following:
            code = bits.golomb()
            delta = (code + 1) // 2 if code % 2 else -(code // 2)
            following = (last + delta) % 256
        last = following or last


def _units(data: bytes) -> Iterator[bytes]:
    """Return the H.264 units between start codes; a unit has one byte or more."""
    start = data.find(b"\x00\x00\x01")
    while start >= 0:
        start += 3
        end = data.find(b"\x00\x00\x01", start)
        unit = data[start:end] if end >= 0 else data[start:]
        if unit:
            yield unit
        start = end


def _unescape(data: bytes) -> bytes:
    """Return an H.264 unit without emulation prevention bytes."""
    return data.replace(b"\x00\x00\x03", b"\x00\x00")
