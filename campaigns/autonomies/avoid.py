"""Evade an object that flies at the vehicle: the autonomy of the paper's third scenario.

"Measured the bounding boxes of objects to judge whether an item was moving towards the quadrotor.
If that is the case, the quadrotor will attempt to avoid it by moving upwards" (section IV). The
logarithm of a box's area grows at twice the ratio of approach speed to distance, whatever the
object's size.

The area is taken of the longer side. A detector errs by about as many pixels at each side: of a
drone that stands still, seen from above, the longer side varied by 8 % and the shorter one, a
quarter of it, by 17 %, so that the product of both grew without an approach. Such errors last for
some 0.3 s (correlation of 0.65 from image to image): the window has to be several times as long for
the standard error to know of them. And they are those of boxes of which the detector is unsure: the
longer side varied by 12 % below a score of 0.65, by 5 % from 0.7 on.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from wil_campaign.api import CameraReading, Command, Reading, Telemetry

from .box_flight import BoxFlight, BoxFlightParameters
from .flight_frame import PositionController


@dataclass(frozen=True, slots=True)
class AvoidParameters(BoxFlightParameters):
    """The parameters of obstacle avoidance, in addition to the common ones: the keys of `with`.

    growth_per_s: growth of the logarithm of the box's area, the square of its longer side, from
    which the object counts as approaching. The measured growth has to exceed it by so many
    standard_errors, in so many images in a row (confirmations). window_s: time over which the
    growth is measured, from at least least_boxes boxes of at least least_score. climb_m,
    climb_speed_m_s: of the evasion. object: class of the detector.
    """

    growth_per_s: float = 0.6
    standard_errors: float = 2.0
    confirmations: float = 4
    window_s: float = 1.2
    least_boxes: float = 5
    least_score: float = 0.65
    climb_m: float = 0.6
    climb_speed_m_s: float = 0.8
    object: str = "quadrotor"
    for_s: float = 11.0


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
        own = self._parameters = self._flight.parameters
        self._finder = own.finder(own.object)
        level, height = own.gains(0.5), own.gains(own.climb_speed_m_s, times=2.0)
        self._controller = PositionController((level, level, height))
        self._log_areas: deque[tuple[float, float]] = deque()
        self._growing_in_a_row = 0
        self._is_evading = False

    def perceive(self, reading: Reading) -> None:
        """Look for the object in an image, and judge whether it grows."""
        is_watching = self._flight.frame is not None and not self._is_evading
        if not isinstance(reading, CameraReading) or not is_watching:
            return
        own = self._parameters
        box = self._finder.find(reading)
        if box is None or box.score < own.least_score:
            return
        side_px = max(box.right_px - box.left_px, box.bottom_px - box.top_px)
        if side_px <= 0.0:
            return
        self._log_areas.append((reading.t_s, 2.0 * math.log(side_px)))
        while self._log_areas[0][0] < reading.t_s - own.window_s:
            self._log_areas.popleft()
        growth, error = line_slope(tuple(self._log_areas))
        is_growing = len(self._log_areas) >= own.least_boxes
        is_growing = is_growing and growth - own.standard_errors * error >= own.growth_per_s
        self._growing_in_a_row = self._growing_in_a_row + 1 if is_growing else 0
        self._is_evading = self._growing_in_a_row >= own.confirmations

    def act(self, telemetry: Telemetry) -> Command:
        """Return the velocity setpoint that holds the position, or the one above it."""
        frame = self._flight.ensure_begun(telemetry)
        climb_m = self._parameters.climb_m if self._is_evading else 0.0
        wanted_m = (0.0, 0.0, self._flight.down_m(frame, climb_m=climb_m))
        velocity = self._controller.velocity(wanted_m, telemetry, frame)
        note = "evade" if self._is_evading else "watch"
        return Command(frame.setpoint(velocity), self._flight.is_over(telemetry), note)


def line_slope(points: tuple[tuple[float, float], ...]) -> tuple[float, float]:
    """Return the slope of the straight line nearest to points (x, y), and its standard error.

    By least squares; 0 where all x are equal. The error is that of independent deviations in y, 0
    for fewer than three points. A box that jumps once gives a steep slope with a large error.
    """
    count = len(points)
    mean_x = sum(x for x, _ in points) / count
    mean_y = sum(y for _, y in points) / count
    spread = sum((x - mean_x) ** 2 for x, _ in points)
    if spread <= 0.0:
        return 0.0, 0.0
    slope = sum((x - mean_x) * (y - mean_y) for x, y in points) / spread
    if count < 3:
        return slope, 0.0
    residual = sum((y - mean_y - slope * (x - mean_x)) ** 2 for x, y in points)
    return slope, math.sqrt(residual / (count - 2) / spread)
