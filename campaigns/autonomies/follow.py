"""Follow a person that the camera sees: the autonomy of the paper's second scenario.

"The subsystem uses the bounding box's center to align the quadrotor with the person while using
the bounding box's area to keep the person a set distance away" (section IV). It keeps the heading
of its start and moves sideways with the person; it has no other data of the person's position.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import median

from wil_campaign.api import (
    CameraReading,
    Command,
    PoseHistory,
    Reading,
    Telemetry,
    quat_from_euler,
)

from .box_flight import BoxFlight, BoxFlightParameters
from .box_sight import box_sight
from .flight_frame import PositionController
from .gate_sight import GateCameraView
from .pid import PidGains


@dataclass(frozen=True, slots=True)
class FollowParameters(BoxFlightParameters):
    """The parameters of person following, in addition to the common ones: the keys of `with`.

    distance_m: to the person. person_m2: width times height of the box of a person who walks
    across. side_speed_m_s, ahead_speed_m_s: limits of the commands; ahead_kp: of the controller
    ahead, kp, ki, kd of those sideways and in height. smooth_s: time over which the median of the
    distance is taken. lost_s: time without a person after which it holds its position.
    camera_stabilized: a gimbal keeps the camera level.
    """

    distance_m: float = 3.25
    person_m2: float = 0.8
    side_speed_m_s: float = 1.5
    ahead_speed_m_s: float = 0.3
    ahead_kp: float = 0.4
    smooth_s: float = 1.0
    lost_s: float = 0.7
    camera_stabilized: bool = False


@dataclass(frozen=True, slots=True)
class _PersonPosition:
    """The person's position at a time, in the flight frame: ahead and to the right, metres."""

    t_s: float
    ahead_m: float
    right_m: float


class FollowAutonomy:
    """The shipped autonomy `follow`: keeps a person in front at a distance, by a detector's box."""

    def __init__(
        self, *, goal: Mapping[str, float | str], parameters: Mapping[str, object], seed: int
    ) -> None:
        """Raise ValueError on unknown follow parameters, or ones of the wrong type.

        parameters: those of FollowParameters. goal: altitude_m. seed: unused.
        """
        del seed
        self._flight = BoxFlight(
            FollowParameters, goal=goal, parameters=parameters, owner="follow autonomy"
        )
        own = self._parameters = self._flight.parameters
        self._finder = own.finder("person")
        self._history = PoseHistory(2.0, max_gap_s=0.6, max_prediction_s=0.1)
        ahead = PidGains(own.ahead_kp, 0.0, 0.0, own.ahead_speed_m_s)
        side, height = own.gains(own.side_speed_m_s), own.gains(0.5)
        self._controller = PositionController((ahead, side, height))
        self._hold_m = (0.0, 0.0)
        self._positions: deque[_PersonPosition] = deque()

    def perceive(self, reading: Reading) -> None:
        """Look for the person in an image; other readings, and early images, are ignored."""
        frame = self._flight.frame
        if not isinstance(reading, CameraReading) or frame is None:
            return
        pose = self._history.at(reading.t_s).pose
        box = self._finder.find(reading) if pose is not None else None
        if pose is None or box is None:
            return
        level = quat_from_euler(0.0, 0.0, pose.yaw_rad)
        q_wxyz = level if self._parameters.camera_stabilized else pose.q_wxyz
        sight = box_sight(box, GateCameraView(reading.intrinsics, q_wxyz, frame.start.yaw_rad))
        if sight is None:
            return
        away_m = math.sqrt(self._parameters.person_m2 / sight.area)
        ahead_m, right_m, _ = frame.position(pose.position_ned_m)
        self._positions.append(
            _PersonPosition(reading.t_s, ahead_m + away_m, right_m + sight.right * away_m)
        )
        while self._positions[0].t_s < reading.t_s - self._parameters.smooth_s:
            self._positions.popleft()

    def act(self, telemetry: Telemetry) -> Command:
        """Return the velocity setpoint that keeps the person in front, at the distance."""
        self._history.add(telemetry.t_s, telemetry.pose, telemetry.velocity_ned_m_s)
        frame = self._flight.ensure_begun(telemetry)
        own, positions = self._parameters, self._positions
        is_following = bool(positions) and telemetry.t_s - positions[-1].t_s <= own.lost_s
        if is_following:
            ahead_m = median(position.ahead_m for position in positions) - own.distance_m
            self._hold_m = (ahead_m, positions[-1].right_m)
        wanted_m = (*self._hold_m, self._flight.down_m(frame))
        velocity = self._controller.velocity(wanted_m, telemetry, frame)
        if not is_following and positions:
            ahead_m, right_m, _ = frame.position(telemetry.pose.position_ned_m)
            self._hold_m = (ahead_m, right_m)
            positions.clear()
        note = "follow" if is_following else "search"
        return Command(frame.setpoint(velocity), self._flight.is_over(telemetry), note)
