"""Finds that two vehicles have one system id and arrive as one; pure."""

from collections import deque
from collections.abc import Callable
from itertools import pairwise
from struct import Struct
from typing import Any

_STAMP = Struct("<I")
_OVER_S = 2.0
_TWICE = 1.6
"""By how much more often than asked for positions of two vehicles arrive, at least."""
_NOT_NEWER = 0.25
"""The share of positions that are not newer than one before, with two clocks, at least."""
_CLOCK_STEPS = 3
_CLOCK_STEP_MS = 1000
"""How often a clock goes back by a second and more within the time: a reboot does it once."""
_BEATS = 7
_BEAT_S = 1.0
"""HEARTBEAT comes once a second from both autopilots, and once more when a mode is changed."""
_BEAT_WITHIN_S = 0.08
_UIDS = "two uids"
_DOUBLED = 32
_SECOND_FRAMES = 5
"""So many frames of a second vehicle's state, in a sequence of their own, show it."""


class SecondVehicle:
    """Finds a second vehicle behind the ids of the first one, by any of four signs.

    Two uids in AUTOPILOT_VERSION; a second sequence of an autopilot's frames; positions more
    often than asked for, by two clocks; heartbeats in two phases. Each is found alone: a router
    may number frames anew, and simulations have equal uids. on_found: called once, with the text.
    """

    def __init__(self) -> None:
        self._sign = ""
        self.position_hz = 0.0
        """The rate of positions that is asked for; 0 while unknown."""
        self.on_found: Callable[[str, float], None] | None = None
        self._uids: list[str] = []
        self._second_frames = 0
        self._positions: deque[tuple[float, bool, bool]] = deque()
        """Arrival, whether it is not newer, and whether its clock went back far."""
        self._older = self._steps_back = 0
        """How many of them are not newer, and had a clock that went back far."""
        self._newest_ms = -1
        self._last_ms = -1
        self._doubled: deque[bytes] = deque(maxlen=_DOUBLED)
        """What came lately, and is no sign when it is doubled on its way."""
        self._beats: deque[float] = deque(maxlen=_BEATS)
        self._doubled_beats: deque[bytes] = deque(maxlen=_BEATS)

    @property
    def found(self) -> str:
        """Return what shows that there are two vehicles, in words; empty for nothing."""
        if not self._sign or len(self._uids) < 2:
            return self._sign
        uids = f"AUTOPILOT_VERSION comes with the uids {' and '.join(self._uids)}"
        return uids if self._sign == _UIDS else f"{self._sign}, and {uids}"

    def version(self, message: Any, t_s: float) -> None:
        """Take an AUTOPILOT_VERSION."""
        uid2 = bytes(message.uid2)
        uid = uid2.hex() if any(uid2) else f"{message.uid:016x}"
        if uid not in self._uids:
            self._uids.append(uid)
        if len(self._uids) > 1:
            self._find(_UIDS, t_s)

    def second_frame(self, t_s: float, *, are_two: bool) -> None:
        """Take a second vehicle's frame (`VehicleFrames`). are_two: the sequences alternate."""
        self._second_frames += 1
        if are_two and self._second_frames >= _SECOND_FRAMES:
            self._find("two sequences of frames interleave", t_s)

    def position(self, payload: bytes, t_s: float) -> None:
        """Take a LOCAL_POSITION_NED."""
        if payload in self._doubled:
            return
        self._doubled.append(payload)
        (boot_ms,) = _STAMP.unpack(payload[:4].ljust(4, b"\0"))
        back = self._last_ms - boot_ms >= _CLOCK_STEP_MS
        positions = self._positions
        older = boot_ms <= self._newest_ms
        positions.append((t_s, older, back))
        self._older += older
        self._steps_back += back
        self._last_ms = boot_ms
        self._newest_ms = boot_ms if back else max(self._newest_ms, boot_ms)
        if positions[0][0] > t_s - _OVER_S:
            return  # not yet long enough
        while positions[0][0] <= t_s - _OVER_S:
            _, older, back = positions.popleft()
            self._older -= older
            self._steps_back -= back
        rate_hz = len(positions) / _OVER_S
        if self._steps_back >= _CLOCK_STEPS:
            self._find(f"positions arrive at {rate_hz:.0f} Hz by two clocks", t_s)
        often = 0.0 < _TWICE * self.position_hz <= rate_hz
        if often and self._older >= _NOT_NEWER * len(positions):
            asked = f"instead of the {self.position_hz:.0f} Hz asked for"
            self._find(f"positions arrive at {rate_hz:.0f} Hz {asked}, by two clocks", t_s)

    def heartbeat(self, frame_bytes: bytes, t_s: float) -> None:
        """Take a heartbeat of the vehicle's kind, as the bytes of its frame."""
        if frame_bytes in self._doubled_beats:
            return
        self._doubled_beats.append(frame_bytes)
        beats = self._beats
        beats.append(t_s)
        if len(beats) < _BEATS:
            return
        gaps = [later - earlier for earlier, later in pairwise(beats)]
        same = all(abs(gap - gaps[n % 2]) <= _BEAT_WITHIN_S for n, gap in enumerate(gaps))
        if same and abs(gaps[0] + gaps[1] - _BEAT_S) <= _BEAT_WITHIN_S:
            self._find("heartbeats come twice a second, in two phases", t_s)

    def _find(self, sign: str, t_s: float) -> None:
        if self._sign:
            return
        self._sign = sign
        if self.on_found is not None:
            self.on_found(self.found, t_s)
