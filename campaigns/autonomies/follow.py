"""Follow a person whom the camera sees: the autonomy of the paper's second scenario.

"The subsystem uses the bounding box's center to align the quadrotor with the person while using
the bounding box's area to keep the person a set distance away" (section IV). It keeps the heading
of its start and moves sideways with the person; it knows neither where the person is nor how fast.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import median

from campaigns.api import (
    CameraReading,
    Command,
    PoseHistory,
    Reading,
    Telemetry,
    quat_from_euler,
)
from campaigns.autonomies.box_flight import BoxFlight, BoxFlightParameters
from campaigns.autonomies.box_sight import box_sight
from campaigns.autonomies.gate_sight import View
from campaigns.autonomies.hover_frame import PositionController
from campaigns.autonomies.pid import Gains


@dataclass(frozen=True, slots=True)
class FollowParameters(BoxFlightParameters):
    """The parameters of person following: what may stand under `with`, beside the common ones.

    distance_m: to be kept. person_m2: width times height of a person as a box shows one who walks
    across. side_speed_m_s, ahead_speed_m_s: most that is asked; ahead_kp: of the controller ahead,
    kp, ki, kd of those sideways and in height. smooth_s: of the boxes whose median area tells the
    distance. lost_s: without a person for so long it holds its place. camera_stabilized: a gimbal
    keeps the camera level.
    """

    distance_m: float = 3.25
    person_m2: float = 0.8
    side_speed_m_s: float = 1.5
    ahead_speed_m_s: float = 0.3
    ahead_kp: float = 0.4
    smooth_s: float = 1.0
    lost_s: float = 0.7
    camera_stabilized: bool = False
    names: str = "person"


@dataclass(frozen=True, slots=True)
class _Seen:
    """Where the person was at a time, in the flight frame: ahead and to the right, metres."""

    t_s: float
    ahead_m: float
    right_m: float


class FollowAutonomy:
    """The shipped autonomy `follow`: keeps a person in front, at a distance, by the box it sees."""

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
        chosen = self._set = self._flight.chosen
        self._finder = chosen.finder("person")
        self._history = PoseHistory(2.0, max_gap_s=0.6, max_prediction_s=0.1)
        ahead = Gains(chosen.ahead_kp, 0.0, 0.0, chosen.ahead_speed_m_s)
        side, height = chosen.gains(chosen.side_speed_m_s), chosen.gains(0.5)
        self._controller = PositionController((ahead, side, height))
        self._hold_m = (0.0, 0.0)
        self._seen: deque[_Seen] = deque()

    def perceive(self, reading: Reading) -> None:
        """Look for the person in an image; other readings, and early images, are ignored."""
        frame = self._flight.frame
        if not isinstance(reading, CameraReading) or frame is None:
            return
        pose = self._history.at(reading.t_s).pose
        found = self._finder.find(reading) if pose is not None else None
        if pose is None or found is None:
            return
        heading_rad = frame.start.yaw_rad
        level = quat_from_euler(0.0, 0.0, pose.yaw_rad)
        q_wxyz = level if self._set.camera_stabilized else pose.q_wxyz
        sight = box_sight(found, View(reading.intrinsics, q_wxyz, heading_rad))
        if sight is None:
            return
        away_m = math.sqrt(self._set.person_m2 / sight.area)
        ahead_m, right_m, _ = frame.place(pose.position_ned_m)
        self._seen.append(_Seen(reading.t_s, ahead_m + away_m, right_m + sight.right * away_m))
        while self._seen[0].t_s < reading.t_s - self._set.smooth_s:
            self._seen.popleft()

    def act(self, telemetry: Telemetry) -> Command:
        """Return the velocity setpoint that keeps the person in front, at the distance."""
        self._history.add(telemetry.t_s, telemetry.pose, telemetry.velocity_ned_m_s)
        frame = self._flight.begun(telemetry)
        follows = bool(self._seen) and telemetry.t_s - self._seen[-1].t_s <= self._set.lost_s
        if follows:
            ahead_m = median(one.ahead_m for one in self._seen) - self._set.distance_m
            self._hold_m = (ahead_m, self._seen[-1].right_m)
        wanted_m = (*self._hold_m, self._flight.down_m(frame))
        velocity = self._controller.velocity(wanted_m, telemetry, frame)
        if not follows and self._seen:
            ahead_m, right_m, _ = frame.place(telemetry.pose.position_ned_m)
            self._hold_m = (ahead_m, right_m)
            self._seen.clear()
        note = "follow" if follows else "search"
        return Command(frame.setpoint(velocity), self._flight.is_over(telemetry), note)
