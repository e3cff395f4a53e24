"""A firmware's automatic manoeuvres: behaviours built from its parameters and the state."""

import math
from abc import ABC, abstractmethod

from wil_campaign.vehicles.embedded.autopilot.flight.autopilot_state import AutopilotState
from wil_campaign.vehicles.embedded.autopilot.flight.guidance import (
    GoToBehaviour,
    GuidanceBehaviour,
    GuidanceSpeeds,
    HoldBehaviour,
    LandBehaviour,
    LandProfile,
    ReturnHomeBehaviour,
    TakeOffBehaviour,
)
from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import ParameterTable
from wil_campaign.vehicles.embedded.autopilot.flight.places import FASTEST_M_S
from wil_campaign.worlds.frames import Vec3

_UP_FROM, _DOWN_FROM = 1.9, 2.9
"""SPEED_TYPE from which a climb's or a descent's speed is changed (GCS_Mavlink.cpp of Copter)."""


class Manoeuvres(ABC):
    """Builds the behaviours of manoeuvres; each firmware uses its own parameters.

    zero_keeps_height: whether a mission's waypoint with a height of 0 is at the present one.
    """

    zero_keeps_height = False

    def __init__(self, parameters: ParameterTable, state: AutopilotState) -> None:
        self._p = parameters
        self._state = state
        self._changed: dict[str, float] = {}

    @abstractmethod
    def default_speeds(self) -> GuidanceSpeeds:
        """Return the speed limits of automatic manoeuvres by parameters."""

    def speeds(self) -> GuidanceSpeeds:
        """Return the speed limits of automatic manoeuvres, DO_CHANGE_SPEED included."""
        speeds = self.default_speeds()
        return speeds._replace(**self._changed) if self._changed else speeds

    def change_speed(self, kind: float, speed_m_s: float) -> bool:
        """Execute DO_CHANGE_SPEED: from 3 on down, from 2 up, others across; False if refused."""
        if not speed_m_s > 0.0:
            return False
        name = "down" if kind > _DOWN_FROM else "up" if kind > _UP_FROM else "across"
        self._changed[name] = min(speed_m_s, FASTEST_M_S)
        return True

    def forget_speeds(self) -> None:
        """Reset DO_CHANGE_SPEED: another mode is flown."""
        self._changed.clear()

    @abstractmethod
    def return_speeds(self) -> GuidanceSpeeds:
        """Return the speed limits of the return manoeuvre."""

    @abstractmethod
    def return_height_m(self) -> float:
        """Return the height above home of the return manoeuvre from here."""

    @abstractmethod
    def return_wait_s(self) -> float:
        """Return how long the return manoeuvre waits above home before landing."""

    def return_end_m(self) -> float | None:
        """Return the height above home at which the return ends; None: it lands."""
        return None

    @abstractmethod
    def land_profile(self) -> LandProfile:
        """Return the descent speeds of the landing manoeuvre."""

    @abstractmethod
    def take_off(self, down_m: float) -> TakeOffBehaviour:
        """Return the takeoff manoeuvre to a local height."""

    @abstractmethod
    def waypoint(self, position_ned_m: Vec3, *, yaw_deg: float) -> GoToBehaviour:
        """Return the manoeuvre to a place of a mission. yaw_deg: of its item, NaN for none."""

    def stay_at(self, position_ned_m: Vec3, *, yaw_deg: float) -> GoToBehaviour:
        """Return the manoeuvre to a place, and to stay there. yaw_deg: as of a waypoint."""
        return GoToBehaviour(
            position_ned_m=position_ned_m,
            yaw_rad=self.staying_yaw_rad(yaw_deg),
            speeds=self.speeds(),
            radius_m=0.0,
        )

    def staying_yaw_rad(self, yaw_deg: float) -> float:
        """Return the heading at a place to stay at, radians. yaw_deg: as of a waypoint."""
        del yaw_deg
        return self._state.now.euler_rad[2]

    def hold(self) -> HoldBehaviour:
        """Return the manoeuvre to brake and stay."""
        return HoldBehaviour(speeds=self.speeds(), yaw_rad=self._state.now.euler_rad[2])

    def land(self) -> LandBehaviour:
        """Return the manoeuvre to land here."""
        return LandBehaviour(
            profile=self.land_profile(),
            speeds=self.speeds(),
            ground_down_m=self._state.home_down_m,
        )

    def go_home(self) -> GuidanceBehaviour:
        """Return the manoeuvre of the return: the flight home, the wait, the landing or stay."""
        home = self._state.home_ned_m or (0.0, 0.0, 0.0)
        end_m = self.return_end_m()
        return ReturnHomeBehaviour(
            home_ned_m=home,
            return_down_m=home[2] - self.return_height_m(),
            speeds=self.return_speeds(),
            wait_s=self.return_wait_s(),
            land=self.land(),
            end_down_m=None if end_m is None else home[2] - end_m,
        )

    def from_home_m(self, place_ned_m: Vec3 | None = None) -> tuple[float, float]:
        """Return the horizontal distance from home, and the height above it; None: of here."""
        north, east, down = self._state.home_ned_m or (0.0, 0.0, 0.0)
        here = place_ned_m or self._state.now.position_ned_m
        return math.hypot(here[0] - north, here[1] - east), down - here[2]
