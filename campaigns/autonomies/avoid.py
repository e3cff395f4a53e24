"""Evade what flies at the vehicle: the autonomy of the paper's third scenario.

"Measured the bounding boxes of objects to judge whether an item was moving towards the quadrotor.
If that is the case, the quadrotor will attempt to avoid it by moving upwards" (section IV). How
fast the logarithm of a box's area grows is twice the speed of approach by the distance, whatever
the object's size.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from campaigns.api import CameraReading, Command, Reading, Telemetry
from campaigns.autonomies.box_sight import BoxFinder
from campaigns.autonomies.hover_frame import FlightFrame, PositionController
from campaigns.autonomies.parameters import goal_altitude_m, read_parameters
from campaigns.autonomies.pid import Gains


@dataclass(frozen=True, slots=True)
class AvoidParameters:
    """The parameters of obstacle avoidance: what may stand under `with`.

    growth_per_s: of the logarithm of the box's area, from which on the object comes nearer; in
    how many images in a row (confirmations). window_s: of the boxes that tell the growth, of which
    there must be least_boxes. climb_m, climb_speed_m_s: the evasion. for_s: then it is done. kp,
    ki, kd: of the controllers. object: class of the detector. model, names (comma between),
    input_px: of another detector, an ONNX file beside this one.
    """

    growth_per_s: float = 0.6
    confirmations: float = 4
    window_s: float = 0.6
    least_boxes: float = 5
    climb_m: float = 0.6
    climb_speed_m_s: float = 0.8
    for_s: float = 11.0
    kp: float = 1.2
    ki: float = 0.06
    kd: float = 0.15
    object: str = "quadrotor"
    model: str = ""
    names: str = "quadrotor"
    input_px: float = 640


_MAY_BE_ZERO = frozenset({"ki", "kd"})


class AvoidAutonomy:
    """The shipped autonomy `avoid`: hovers, and climbs away from a box that grows."""

    def __init__(
        self, *, goal: Mapping[str, float | str], parameters: Mapping[str, object], seed: int
    ) -> None:
        """Raise ValueError on unknown avoid parameters, or ones of the wrong type.

        parameters: those of AvoidParameters. goal: altitude_m. seed: unused.
        """
        del seed
        chosen = read_parameters(
            AvoidParameters, parameters, "avoid autonomy", may_be_zero=_MAY_BE_ZERO
        )
        self._set = chosen
        self._altitude_m = goal_altitude_m(goal, "avoid autonomy")
        names = [name.strip() for name in chosen.names.split(",")]
        self._finder = BoxFinder(
            chosen.object, model=chosen.model, names=names, input_px=round(chosen.input_px)
        )
        level = Gains(chosen.kp, chosen.ki, chosen.kd, 0.5)
        height = Gains(2.0 * chosen.kp, chosen.ki, chosen.kd, chosen.climb_speed_m_s)
        self._controller = PositionController((level, level, height))
        self._frame: FlightFrame | None = None
        self._began_s = 0.0
        self._boxes: deque[tuple[float, float]] = deque()
        self._in_a_row = 0
        self._evades = False

    def perceive(self, reading: Reading) -> None:
        """Look for the object in an image, and judge whether it grows."""
        if not isinstance(reading, CameraReading) or self._frame is None or self._evades:
            return
        found = self._finder.find(reading)
        if found is None:
            return
        area_px2 = (found.right_px - found.left_px) * (found.bottom_px - found.top_px)
        if area_px2 <= 0.0:
            return
        self._boxes.append((reading.t_s, math.log(area_px2)))
        while self._boxes[0][0] < reading.t_s - self._set.window_s:
            self._boxes.popleft()
        grows = len(self._boxes) >= self._set.least_boxes
        grows = grows and slope(tuple(self._boxes)) >= self._set.growth_per_s
        self._in_a_row = self._in_a_row + 1 if grows else 0
        self._evades = self._in_a_row >= self._set.confirmations

    def act(self, telemetry: Telemetry) -> Command:
        """Return the velocity setpoint that holds the place, or the one above it."""
        if self._frame is None:
            self._frame = FlightFrame(telemetry.pose)
            self._began_s = telemetry.t_s
        altitude_m = self._altitude_m + (self._set.climb_m if self._evades else 0.0)
        down_m = -altitude_m - self._frame.start.position_ned_m[2]
        velocity = self._controller.velocity((0.0, 0.0, down_m), telemetry, self._frame)
        done = telemetry.t_s - self._began_s >= self._set.for_s
        return Command(self._frame.setpoint(velocity), done, "evade" if self._evades else "watch")


def slope(points: tuple[tuple[float, float], ...]) -> float:
    """Return the slope of the straight line nearest to points (x, y); 0 where all x are one."""
    count = len(points)
    middle_x = sum(x for x, _ in points) / count
    middle_y = sum(y for _, y in points) / count
    spread = sum((x - middle_x) ** 2 for x, _ in points)
    shared = sum((x - middle_x) * (y - middle_y) for x, y in points)
    return shared / spread if spread > 0.0 else 0.0
