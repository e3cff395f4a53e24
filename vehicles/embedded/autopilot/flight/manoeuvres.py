"""What a firmware flies by itself: behaviours made from its parameters and the state."""

import math
from abc import ABC, abstractmethod

from vehicles.embedded.autopilot.flight.autopilot_state import State
from vehicles.embedded.autopilot.flight.guidance import (
    Behaviour,
    GoTo,
    Hold,
    Land,
    LandProfile,
    ReturnHome,
    Speeds,
    TakeOff,
)
from vehicles.embedded.autopilot.flight.parameter_table import Parameters
from worlds.frames import Vec3


class Manoeuvres(ABC):
    """Makes behaviours; each firmware says by which of its parameters."""

    def __init__(self, parameters: Parameters, state: State) -> None:
        self._p = parameters
        self._state = state

    @abstractmethod
    def speeds(self) -> Speeds:
        """Return the limits of the automatic modes."""

    @abstractmethod
    def return_speeds(self) -> Speeds:
        """Return the limits of the flight home."""

    @abstractmethod
    def return_height_m(self) -> float:
        """Return how high above home to fly back from here."""

    @abstractmethod
    def return_wait_s(self) -> float:
        """Return how long to wait above home before landing."""

    @abstractmethod
    def land_profile(self) -> LandProfile:
        """Return how fast to come down by height above ground."""

    @abstractmethod
    def take_off(self, down_m: float) -> TakeOff:
        """Return the climb to a local height."""

    @abstractmethod
    def waypoint(self, position_ned_m: Vec3) -> GoTo:
        """Return the flight to a place of a mission."""

    def hold(self) -> Hold:
        """Return to brake and stay."""
        return Hold(speeds=self.speeds(), yaw_rad=self._state.now.euler_rad[2])

    def land(self) -> Land:
        """Return the landing here."""
        return Land(
            profile=self.land_profile(),
            speeds=self.speeds(),
            ground_down_m=self._state.home_down_m,
        )

    def go_home(self) -> Behaviour:
        """Return the flight home, the wait above it, and the landing."""
        home = self._state.home_ned_m or (0.0, 0.0, 0.0)
        return ReturnHome(
            home_ned_m=home,
            return_down_m=home[2] - self.return_height_m(),
            speeds=self.return_speeds(),
            wait_s=self.return_wait_s(),
            land=self.land(),
        )

    def from_home_m(self) -> tuple[float, float]:
        """Return how far it is from home, across and above."""
        north, east, down = self._state.home_ned_m or (0.0, 0.0, 0.0)
        here = self._state.now.position_ned_m
        return math.hypot(here[0] - north, here[1] - east), down - here[2]
