"""Common part of flights by a detector's box: parameters, frame, height, duration."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar, get_args

from wil_campaign.api import Telemetry

from .box_sight import BoxFinder, Layout
from .flight_frame import FlightFrame
from .parameters import goal_altitude_m, read_autonomy_parameters
from .pid import PidGains

_MAY_BE_ZERO = frozenset({"ki", "kd", "standard_errors"})
_CHOICES = {"layout": get_args(Layout)}


@dataclass(frozen=True, slots=True)
class BoxFlightParameters:
    """The parameters of every flight by a detector's box.

    for_s: duration of the flight. kp, ki, kd: of the controllers. model, names (separated by
    commas; empty for those that the file states), input_px, layout: of a detector other than the
    shipped one, an ONNX file beside this file; layout: of its output.
    """

    for_s: float = 12.0
    kp: float = 1.2
    ki: float = 0.06
    kd: float = 0.15
    model: str = ""
    names: str = ""
    input_px: float = 640
    layout: Layout = "auto"

    def finder(self, wanted: str) -> BoxFinder:
        """Return a finder of boxes of one class. Raises ValueError, DetectorError."""
        names = [name.strip() for name in self.names.split(",")] if self.names else []
        return BoxFinder(
            wanted,
            model=self.model,
            names=names,
            input_px=round(self.input_px),
            layout=self.layout,
        )

    def gains(self, limit_m_s: float, *, times: float = 1.0) -> PidGains:
        """Return the gains of a controller. limit_m_s: of its output; times: factor of kp."""
        return PidGains(times * self.kp, self.ki, self.kd, limit_m_s)


Parameters = TypeVar("Parameters", bound=BoxFlightParameters)


class BoxFlight(Generic[Parameters]):
    """A flight at the goal's altitude that keeps the heading of its start for a set time.

    owner: the autonomy's name in messages. Raises ValueError on unknown or wrong parameters, and
    without an altitude.
    """

    def __init__(
        self,
        kind: type[Parameters],
        *,
        goal: Mapping[str, float | str],
        parameters: Mapping[str, object],
        owner: str,
    ) -> None:
        self.parameters = read_autonomy_parameters(
            kind, parameters, owner, may_be_zero=_MAY_BE_ZERO, choices=_CHOICES
        )
        self.frame: FlightFrame | None = None
        self._altitude_m = goal_altitude_m(goal, owner)
        self._began_s = 0.0

    def ensure_begun(self, telemetry: Telemetry) -> FlightFrame:
        """Return the frame of the flight; the first call begins the flight at its pose and time."""
        if self.frame is None:
            self.frame = FlightFrame(telemetry.pose)
            self._began_s = telemetry.t_s
        return self.frame

    def down_m(self, frame: FlightFrame, *, climb_m: float = 0.0) -> float:
        """Return the goal's altitude, plus a climb, as the frame's down coordinate."""
        return -(self._altitude_m + climb_m) - frame.start.position_ned_m[2]

    def is_over(self, telemetry: Telemetry) -> bool:
        """Return whether the duration of the flight is over."""
        return telemetry.t_s - self._began_s >= self.parameters.for_s
