"""Chooses the frames of one vehicle among all that have its ids, by their sequence; pure.

Every sender of MAVLink counts its frames on a link by one byte. Two of them behind one router, with
one system and component id, give two sequences that interleave, and each number comes twice, in two
frames; of one sender each comes once, wherever loss and jitter put it.
"""

import math
from collections import deque
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.mavlink.framing import MavlinkFrame

_NEAR = 8
"""A frame that is so many numbers ahead continues a sequence: those in between were lost."""
_KEPT = 64
"""So many numbers of the past are known: those that came, and those that were skipped."""
_APART = 48
"""Sequences that are further apart than this are of no frames that were overtaken: of nearer ones
the sequence itself shows, when it comes to their numbers, whether they are of it."""
_LEAST_SILENT_S, _MOST_SILENT_S = 0.1, 0.5
_SILENT_PERIODS = 4.0
"""After a silence of so many periods, within these limits, any number continues the sequence: an
outage, a reboot, or a link of the vehicle that counts by itself."""
_LATELY_S = 0.5
"""After so long another sequence that was not continued is none, and a number may come again."""
_HALF_ROUND = 128
"""In so many periods no number is due again, of which there are 256."""
_SHARE = 0.1
"""Share of a new period in the mean one."""
_SIGNS = 6
"""So many signs of two senders in a row: two sequences alternate, both continued and further apart
than a frame is overtaken; or a number comes again in another frame, while it cannot be due."""


class SenderSequence:
    """Splits the frames with one sender's ids into its own and those of a second sender.

    A frame that continues no sequence is held until the next ones show what it was: the same
    sequence after a loss, or another beside it. One that is a little ahead may have overtaken
    others: it is the sequence's own if that passes its number over, and another's if the number
    comes again in another frame. Where two sequences pass through the same numbers,
    which of the two is the sender's may be lost.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._last_s = 0.0
        self._period_s = 0.0
        self._number_s = 0.0
        """How long a number takes on average; unlike a period no longer where some are lost."""
        self._silent_s = _LEAST_SILENT_S
        """After a silence that is longer, any number continues the sequence."""
        self._came: deque[tuple[float, MavlinkFrame]] = deque(maxlen=_KEPT)
        self._skipped: deque[int] = deque(maxlen=_KEPT)
        self._held_back: list[MavlinkFrame] = []
        self._early: list[MavlinkFrame] = []
        """Frames that are ahead of the sequence by no more than frames that overtake others."""
        self._early_in_a_row = 0
        self._other: int | None = None
        """The last number of another sequence."""
        self._other_went_on = False
        """Whether the other sequence was continued since the last frame of the first one."""
        self._other_came: deque[tuple[float, MavlinkFrame]] = deque(maxlen=_KEPT)
        self._signs = 0

    @property
    def are_two(self) -> bool:
        """Return whether two sequences alternate, so that there are two senders."""
        return self._signs >= _SIGNS

    def goes_on(self, frame: MavlinkFrame, t_s: float) -> bool:
        """Take a frame if it is the next of the only sequence, as nearly all are.

        Returns whether it is: `split` would return this frame alone. Else `split` has to take it.
        """
        if (
            self._last is None
            or frame.seq != (self._last + 1) & 0xFF
            or self._held_back
            or self._early
            or self._other is not None
            or t_s - self._last_s > self._silent_s
        ):
            return False
        self._other_went_on = False
        self._accept(frame, t_s)
        return True

    def split(
        self, frame: MavlinkFrame, t_s: float
    ) -> tuple[list[MavlinkFrame], list[MavlinkFrame]]:
        """Take a frame; return frames of the sender, and of another one, that are known by now.

        t_s: its time of arrival. Both are in the order in which they came.
        """
        lately_s = min(_LATELY_S, _HALF_ROUND * self._number_s)
        if self._other_came and t_s - self._other_came[-1][0] > lately_s and not self.are_two:
            self._other = None
        if self._last is None or t_s - self._last_s > self._silent_s:
            if self.are_two and self._other is not None and _ahead(self._other, frame.seq) <= _NEAR:
                return self._continue_other(frame, t_s)
            return self._go_on_after_silence(frame, t_s)
        is_other = self._is_other(frame.seq)
        ahead = _ahead(self._last, frame.seq)
        if not is_other and ahead <= _NEAR:
            return self._go_on(frame, ahead, t_s)
        if self._is_late(frame, t_s):
            return [frame], []
        return self._continue_other(frame, t_s) if is_other else self._hold(frame, ahead, t_s)

    def _go_on(
        self, frame: MavlinkFrame, ahead: int, t_s: float
    ) -> tuple[list[MavlinkFrame], list[MavlinkFrame]]:
        """Take a frame of the sequence, and those that are known by it."""
        overtaking, others = self._take_overtaking(frame, ahead)
        for one in overtaking:
            self._accept(one, t_s)
        self._note_alternation(frame, others, t_s)
        self._accept(frame, t_s)
        return [*overtaking, frame], others

    def _hold(
        self, frame: MavlinkFrame, ahead: int, t_s: float
    ) -> tuple[list[MavlinkFrame], list[MavlinkFrame]]:
        """Hold a frame until the next ones show whose it is."""
        if ahead > _APART or self.are_two:
            self._held_back.append(frame)
            return [], []
        self._early_in_a_row += 1
        if self._has_passed_over(t_s):
            return self._go_on_after_silence(frame, t_s)
        self._early.append(frame)
        return [], []

    def _has_passed_over(self, t_s: float) -> bool:
        """Return whether so many early frames came, and none before them, that these were lost."""
        return (
            self._early_in_a_row >= _NEAR
            and t_s - self._last_s > _SILENT_PERIODS * self._period_s
            and not self._held_back
            and self._signs == 0
        )

    def _go_on_after_silence(
        self, frame: MavlinkFrame, t_s: float
    ) -> tuple[list[MavlinkFrame], list[MavlinkFrame]]:
        """Take a frame after a silence of the sequence, and all that is held, as its own."""
        others = self._early if self.are_two else []
        own = [frame] if self.are_two else [*self._early, frame]
        if self._last is not None and _ahead(self._last, frame.seq) <= _APART:
            last = self._last
            own.sort(key=lambda one: _ahead(last, one.seq))
            for one in own[:-1]:
                self._accept(one, t_s)
        self._accept(own[-1], t_s)
        own[:0], self._early, self._held_back = self._held_back, [], []
        return own, others

    def _take_overtaking(
        self, frame: MavlinkFrame, ahead: int
    ) -> tuple[list[MavlinkFrame], list[MavlinkFrame]]:
        """Return frames before one of the sequence: its own that overtook it, and another's."""
        last = self._last or 0
        others, self._held_back = self._held_back, []
        early, self._early = self._early, []
        own: list[MavlinkFrame] = []
        for one in early:
            by = _ahead(last, one.seq)
            if by > ahead and not self.are_two:
                self._early.append(one)
            elif self._signs == 0 and (by < ahead or one.raw == frame.raw):
                own.append(one)
            else:
                others.append(one)
        return sorted(own, key=lambda one: _ahead(last, one.seq)), others

    def _is_other(self, seq: int) -> bool:
        """Return whether a number continues the other sequence, and the first one less closely."""
        if self._other is None or self._last is None:
            return False
        ahead = _ahead(self._other, seq)
        return ahead <= _NEAR and ahead < _ahead(self._last, seq)

    def _is_late(self, frame: MavlinkFrame, t_s: float) -> bool:
        """Return whether a frame was overtaken by others of its sequence, or doubled."""
        if self._last is None or (self._last - frame.seq) & 0xFF > _KEPT:
            return False
        if frame.seq in self._skipped:
            self._skipped.remove(frame.seq)
            self._came.append((t_s, frame))
            return True
        return any(one.raw == frame.raw for _, one in self._came)

    def _continue_other(
        self, frame: MavlinkFrame, t_s: float
    ) -> tuple[list[MavlinkFrame], list[MavlinkFrame]]:
        self._note_other(frame, t_s)
        self._other_went_on = True
        return [], [frame]

    def _note_alternation(
        self, frame: MavlinkFrame, others: list[MavlinkFrame], t_s: float
    ) -> None:
        """Note that the sequence goes on, after frames of another one if there were any."""
        for one in others:
            self._note_other(one, t_s)
        went_on, self._other_went_on = self._other_went_on, False
        if self._other is None or self.are_two:
            return
        apart = _ahead(frame.seq, self._other)
        is_apart = _APART < apart < 256 - _APART
        if (went_on and is_apart) or self._comes_again(frame, self._other_came, t_s):
            self._signs += 1
        elif others:
            self._signs = 0

    def _note_other(self, frame: MavlinkFrame, t_s: float) -> None:
        """Note a frame of the other sequence."""
        self._other = frame.seq
        self._other_came.append((t_s, frame))
        if self._comes_again(frame, self._came, t_s):
            self._signs += 1

    def _comes_again(
        self, frame: MavlinkFrame, came: deque[tuple[float, MavlinkFrame]], t_s: float
    ) -> bool:
        """Return whether a frame's number came before it is due, in a frame with other bytes."""
        within_s = min(2.0 * _LATELY_S, _HALF_ROUND * self._number_s)
        return any(
            one.seq == frame.seq and one.raw != frame.raw and t_s - at_s <= within_s
            for at_s, one in came
        )

    def _accept(self, frame: MavlinkFrame, t_s: float) -> None:
        if self._last is not None:
            self._period_s += _SHARE * (min(t_s - self._last_s, _MOST_SILENT_S) - self._period_s)
            silent_s = _SILENT_PERIODS * self._period_s
            self._silent_s = min(max(_LEAST_SILENT_S, silent_s), _MOST_SILENT_S)
            ahead = _ahead(self._last, frame.seq)
            if ahead <= _APART:
                self._number_s += _SHARE * ((t_s - self._last_s) / ahead - self._number_s)
            if 1 < ahead <= _APART:
                self._skipped.extend((self._last + one) & 0xFF for one in range(1, ahead))
            elif _APART < ahead < 256:
                self._skipped.clear()
                self._came.clear()
        self._last, self._last_s, self._early_in_a_row = frame.seq, t_s, 0
        self._came.append((t_s, frame))


def _ahead(last: int, seq: int) -> int:
    """Return by how much a number is ahead of another one: 1 for the next, 256 for the same."""
    return ((seq - last - 1) & 0xFF) + 1


_STATE = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        mavlink.MAVLINK_MSG_ID_ODOMETRY,
    }
)
"""What autopilots say of themselves again and again: of two vehicles each one sends it."""
_MEMORY_S = 3.0
"""How long a message counts, to tell which sequence has it: heartbeats come once a second."""
_OWN_SHARE = 0.15
"""Share of a message that is in the vehicle's own sequence, where a second vehicle sends it too.
Less than that are numbers of two sequences that pass each other."""


class VehicleFrames:
    """Passes a vehicle's frames on, without the state of a second vehicle that has its ids.

    A frame of state that is in another sequence than the vehicle's is left out where the vehicle's
    own sequence has the same message: a program that sends some messages with the ids of an
    autopilot is no vehicle, and neither is a relay that numbers those anew that it changes.
    """

    def __init__(self) -> None:
        self._sequence = SenderSequence()
        self._counts: dict[int, _Counts] = {}

    @property
    def are_two(self) -> bool:
        """Return whether two sequences of frames alternate."""
        return self._sequence.are_two

    def split(
        self, frame: MavlinkFrame, t_s: float
    ) -> tuple[list[MavlinkFrame], list[MavlinkFrame]]:
        """Take a frame; return the frames to pass on now, and those of a second vehicle.

        t_s: its time of arrival.
        """
        if self._sequence.goes_on(frame, t_s):
            if frame.message_id in _STATE:
                self._counts_of(frame).note(t_s, own=1.0)
            return [frame], []
        own, others = self._sequence.split(frame, t_s)
        passed = [] if frame.message_id in _STATE else [frame]
        for one in own:
            if one.message_id in _STATE:
                self._counts_of(one).note(t_s, own=1.0)
                passed.append(one)
        second: list[MavlinkFrame] = []
        for one in others:
            if one.message_id in _STATE:
                is_second = self._counts_of(one).note(t_s, other=1.0) >= _OWN_SHARE
                (second if is_second else passed).append(one)
        return passed, second

    def _counts_of(self, frame: MavlinkFrame) -> "_Counts":
        counts = self._counts.get(frame.message_id)
        if counts is None:
            counts = self._counts[frame.message_id] = _Counts()
        return counts


@dataclass(slots=True)
class _Counts:
    """How often a message came lately in the vehicle's own sequence, and in another."""

    own: float = 0.0
    other: float = 0.0
    at_s: float = 0.0

    def note(self, t_s: float, *, own: float = 0.0, other: float = 0.0) -> float:
        """Add a message; return the share of the vehicle's own sequence."""
        left = math.exp(min(0.0, self.at_s - t_s) / _MEMORY_S)
        self.own, self.other, self.at_s = left * self.own + own, left * self.other + other, t_s
        return self.own / (self.own + self.other)
