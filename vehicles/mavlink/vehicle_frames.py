"""Chooses the frames of one vehicle among all that have its ids; pure."""

import math
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.mavlink.framing import Frame
from wil_campaign.vehicles.mavlink.sender_sequence import SenderSequence

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

    def split(self, frame: Frame, t_s: float) -> tuple[list[Frame], list[Frame]]:
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
        second: list[Frame] = []
        for one in others:
            if one.message_id in _STATE:
                is_second = self._counts_of(one).note(t_s, other=1.0) >= _OWN_SHARE
                (second if is_second else passed).append(one)
        return passed, second

    def _counts_of(self, frame: Frame) -> "_Counts":
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
