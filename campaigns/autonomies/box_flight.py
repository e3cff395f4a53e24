"""What flights by the box of a detector have in common: parameters, frame, height, end."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from campaigns.api import Telemetry
from campaigns.autonomies.box_sight import BoxFinder
from campaigns.autonomies.hover_frame import FlightFrame
from campaigns.autonomies.parameters import goal_altitude_m, read_parameters
from campaigns.autonomies.pid import Gains

_MAY_BE_ZERO = frozenset({"ki", "kd", "standard_errors"})


@dataclass(frozen=True, slots=True)
class BoxFlightParameters:
    """The parameters of every flight by a detector's box.

    for_s: then it is done. kp, ki, kd: of the controllers. model, names (comma between), input_px:
    of another detector than the shipped one, an ONNX file beside this one.
    """

    for_s: float = 12.0
    kp: float = 1.2
    ki: float = 0.06
    kd: float = 0.15
    model: str = ""
    names: str = ""
    input_px: float = 640

    def finder(self, wanted: str) -> BoxFinder:
        """Return what finds boxes of a class. Raises ValueError, DetectorError."""
        names = [name.strip() for name in self.names.split(",")]
        return BoxFinder(wanted, model=self.model, names=names, input_px=round(self.input_px))

    def gains(self, most_m_s: float, *, times: float = 1.0) -> Gains:
        """Return the gains of a controller. most_m_s: that it asks; times: of kp."""
        return Gains(times * self.kp, self.ki, self.kd, most_m_s)


Parameters = TypeVar("Parameters", bound=BoxFlightParameters)


class BoxFlight(Generic[Parameters]):
    """A flight at the goal's altitude that keeps the heading of its start for a set time.

    owner: whose, in messages. Raises ValueError on unknown or wrong parameters, and without an
    altitude.
    """

    def __init__(
        self,
        kind: type[Parameters],
        *,
        goal: Mapping[str, float | str],
        parameters: Mapping[str, object],
        owner: str,
    ) -> None:
        self.chosen = read_parameters(kind, parameters, owner, may_be_zero=_MAY_BE_ZERO)
        self.frame: FlightFrame | None = None
        self._altitude_m = goal_altitude_m(goal, owner)
        self._began_s = 0.0

    def begun(self, telemetry: Telemetry) -> FlightFrame:
        """Return the frame of the flight, which begins where and when this is first called."""
        if self.frame is None:
            self.frame = FlightFrame(telemetry.pose)
            self._began_s = telemetry.t_s
        return self.frame

    def down_m(self, frame: FlightFrame, *, climb_m: float = 0.0) -> float:
        """Return the height to be kept as down of the frame, so much above the goal's altitude."""
        return -(self._altitude_m + climb_m) - frame.start.position_ned_m[2]

    def is_over(self, telemetry: Telemetry) -> bool:
        """Return whether the flight has lasted for its time."""
        return telemetry.t_s - self._began_s >= self.chosen.for_s
