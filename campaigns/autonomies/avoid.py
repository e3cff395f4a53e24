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
from campaigns.autonomies.box_flight import BoxFlight, BoxFlightParameters
from campaigns.autonomies.hover_frame import PositionController


@dataclass(frozen=True, slots=True)
class AvoidParameters(BoxFlightParameters):
    """The parameters of obstacle avoidance: what may stand under `with`, beside the common ones.

    growth_per_s: of the logarithm of the box's area, from which on the object comes nearer; it has
    to grow so fast by standard_errors of the growth at least, in how many images in a row
    (confirmations). window_s: of the boxes that tell the growth, of which there must be
    least_boxes. climb_m, climb_speed_m_s: the evasion. object: class of the detector.
    """

    growth_per_s: float = 0.6
    standard_errors: float = 2.0
    confirmations: float = 4
    window_s: float = 0.6
    least_boxes: float = 5
    climb_m: float = 0.6
    climb_speed_m_s: float = 0.8
    object: str = "quadrotor"
    for_s: float = 11.0
    names: str = "quadrotor"


class AvoidAutonomy:
    """The shipped autonomy `avoid`: hovers, and climbs away from a box that grows."""

    def __init__(
        self, *, goal: Mapping[str, float | str], parameters: Mapping[str, object], seed: int
    ) -> None:
        """Raise ValueError on unknown avoid parameters, or ones of the wrong type.

        parameters: those of AvoidParameters. goal: altitude_m. seed: unused.
        """
        del seed
        self._flight = BoxFlight(
            AvoidParameters, goal=goal, parameters=parameters, owner="avoid autonomy"
        )
        chosen = self._set = self._flight.chosen
        self._finder = chosen.finder(chosen.object)
        level, height = chosen.gains(0.5), chosen.gains(chosen.climb_speed_m_s, times=2.0)
        self._controller = PositionController((level, level, height))
        self._boxes: deque[tuple[float, float]] = deque()
        self._in_a_row = 0
        self._evades = False

    def perceive(self, reading: Reading) -> None:
        """Look for the object in an image, and judge whether it grows."""
        is_awaited = self._flight.frame is not None and not self._evades
        if not isinstance(reading, CameraReading) or not is_awaited:
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
        growth, error = line_slope(tuple(self._boxes))
        grows = len(self._boxes) >= self._set.least_boxes
        grows = grows and growth - self._set.standard_errors * error >= self._set.growth_per_s
        self._in_a_row = self._in_a_row + 1 if grows else 0
        self._evades = self._in_a_row >= self._set.confirmations

    def act(self, telemetry: Telemetry) -> Command:
        """Return the velocity setpoint that holds the place, or the one above it."""
        frame = self._flight.begun(telemetry)
        down_m = self._flight.down_m(frame, climb_m=self._set.climb_m if self._evades else 0.0)
        velocity = self._controller.velocity((0.0, 0.0, down_m), telemetry, frame)
        note = "evade" if self._evades else "watch"
        return Command(frame.setpoint(velocity), self._flight.is_over(telemetry), note)


def line_slope(points: tuple[tuple[float, float], ...]) -> tuple[float, float]:
    """Return the slope of the straight line nearest to points (x, y), and its standard error.

    By least squares; 0 where all x are one. The error is that of independent deviations in y, 0
    for fewer than three points: a box that jumps has a steep line, and a doubtful one.
    """
    count = len(points)
    middle_x = sum(x for x, _ in points) / count
    middle_y = sum(y for _, y in points) / count
    spread = sum((x - middle_x) ** 2 for x, _ in points)
    if spread <= 0.0:
        return 0.0, 0.0
    slope = sum((x - middle_x) * (y - middle_y) for x, y in points) / spread
    if count < 3:
        return slope, 0.0
    left = sum((y - middle_y - slope * (x - middle_x)) ** 2 for x, y in points)
    return slope, math.sqrt(left / (count - 2) / spread)
