"""The physics of one quadrotor, by default in JSBSim: thrust commands in, true motion out."""

import math
import os
import struct
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np

from wil_campaign.vehicles.embedded.physics.airframe import MOTORS, Airframe, aircraft_root
from wil_campaign.vehicles.embedded.physics.motion_kernel import (
    BODY_NUMBERS,
    NUMBERS,
    RAW,
    ZERO,
    read_plant_motion,
)
from wil_campaign.vehicles.embedded.physics.states import BodyMotion, motion_of_array
from wil_campaign.vehicles.errors import NO_JSBSIM
from wil_campaign.vehicles.poses.truth import Thrusts
from wil_campaign.worlds.frames import Vec3

os.environ.setdefault("JSBSIM_DEBUG", "0")

try:
    import jsbsim  # it reads JSBSIM_DEBUG when imported
except ModuleNotFoundError:  # it has no wheel for ARM
    jsbsim = None  # type: ignore[assignment]  # mypy has the module

_METRES_PER_FOOT = 0.3048
_TURBULENCE_NONE = 0.0
_NUMBERS = struct.Struct(f"{NUMBERS}d")
"""Packed into an array: a third quicker than assigning a list to it."""


class PlantError(Exception):
    """The simulated plant cannot start, or diverged."""


class _Silent(object if jsbsim is None else jsbsim.FGLogger):  # type: ignore[misc]  # untyped
    """A JSBSim logger that drops the plant's messages, which go to stdout otherwise."""

    def set_level(self, level: object) -> None:
        """Ignore the level of JSBSim's message."""

    def file_location(self, filename: object, line: object) -> None:
        """Ignore the place of JSBSim's message."""

    def message(self, message: object) -> None:
        """Drop JSBSim's message."""

    def format(self, format: object) -> None:  # noqa: A002  # JSBSim's name
        """Ignore the format of JSBSim's message."""

    def flush(self) -> None:
        """Do nothing: no message of JSBSim is kept."""


class Plant(ABC):
    """The simulated plant: one quadrotor on flat ground.

    `motor_factors` multiply the commanded thrusts: the spread between motors. Positions are NED
    metres from its position after settling.
    """

    def __init__(self, motor_factors: Thrusts) -> None:
        self._spread = tuple(map(float, motor_factors))
        self._factors = list(self._spread)
        self.array = np.zeros(BODY_NUMBERS)
        """The body array (see motion_kernel): the plant sets its own numbers."""
        self._raw, self._zero = self.array[RAW], self.array[ZERO]

    @abstractmethod
    def step(self, thrusts: Thrusts, share: float = 1.0) -> None:
        """Advance the plant by one step with a share of these commands, in newtons per motor."""

    @abstractmethod
    def thrusts(self) -> Thrusts:
        """Return each motor's thrust in the plant, newtons: lagging its command."""

    @abstractmethod
    def on_ground(self) -> bool:
        """Return whether a leg of the plant touches the ground."""

    @abstractmethod
    def set_wind(self, wind_ned_m_s: Vec3) -> None:
        """Set the plant's wind, towards north, east and down."""

    def motion(self) -> BodyMotion:
        """Return the plant's true motion. Raises PlantError when a number is not finite."""
        motion = np.zeros(NUMBERS)
        if not read_plant_motion(self._raw, self._zero, motion):
            raise self.divergence()
        return motion_of_array(motion)

    def divergence(self) -> PlantError:
        """Return the error of a plant whose motion is not finite."""
        n, e, u, vn, ve, vd, roll, pitch, yaw, p, q, r, *_ = self._raw.tolist()
        return PlantError(
            f"the simulation diverged: position {(n, e, u)} ft, "
            f"velocity {(vn, ve, vd)} ft/s, attitude {(roll, pitch, yaw)}, rates {(p, q, r)}"
        )

    def fail_motor(self, index: int, *, factor: float = 0.0) -> None:
        """Multiply the thrust that one motor of the plant has by itself by this factor; 1 mends."""
        self._factors[index] = self._spread[index] * factor

    def _settle(self, dt_s: float) -> None:
        """Let the plant's legs settle, then set the origin of positions there."""
        for _ in range(round(0.5 / dt_s)):
            self.step((0.0, 0.0, 0.0, 0.0))
        self._zero[:] = self.motion().position_ned_m


class JsbsimPlant(Plant):
    """The plant in JSBSim."""

    def __init__(
        self,
        *,
        airframe: Airframe,
        motor_lag_s: float,
        motor_factors: Thrusts,
        latitude_deg: float,
        longitude_deg: float,
        altitude_m: float,
        yaw_rad: float,
        rate_hz: int,
    ) -> None:
        super().__init__(motor_factors)
        if jsbsim is None:
            raise PlantError(NO_JSBSIM)
        jsbsim.set_logger(_Silent())
        root = aircraft_root(airframe, motor_lag_s=motor_lag_s)
        fdm = self._fdm = jsbsim.FGFDMExec(str(root))
        fdm.set_debug_level(0)
        if not fdm.load_model("quadx"):
            raise PlantError(f"JSBSim cannot load the aircraft in {root}")
        self._dt_s = 1.0 / rate_hz
        self._start(airframe, latitude_deg, longitude_deg, altitude_m, yaw_rad)
        self._bind()
        self._bytes = self._raw.data.cast("B")
        self._settle(self._dt_s)

    def step(self, thrusts: Thrusts, share: float = 1.0) -> None:
        """Advance the plant by one step with a share of these commands, in newtons per motor."""
        (a, b, c, d), (fa, fb, fc, fd) = thrusts, self._factors
        set_a, set_b, set_c, set_d = self._commands
        set_a(a * share * fa)
        set_b(b * share * fb)
        set_c(c * share * fc)
        set_d(d * share * fd)
        self._run()
        # Called one by one: a list of them takes a tenth of the step more.
        n, e, u, vn, ve, vd, roll, pitch, yaw, p, q, r, x, y, z = self._motion_getters
        _NUMBERS.pack_into(
            self._bytes, 0,
            n(), e(), u(), vn(), ve(), vd(), roll(), pitch(), yaw(), p(), q(), r(), x(), y(), z(),
        )  # fmt: skip

    def thrusts(self) -> Thrusts:
        """Return each motor's thrust in the plant, newtons: lagging its command."""
        a, b, c, d = self._thrust_getters
        return (a(), b(), c(), d())

    def on_ground(self) -> bool:
        """Return whether a leg of the plant touches the ground."""
        a, b, c, d = self._ground_contact_getters
        return bool(a() > 0.0 or b() > 0.0 or c() > 0.0 or d() > 0.0)

    def set_wind(self, wind_ned_m_s: Vec3) -> None:
        """Set the plant's wind, towards north, east and down."""
        for set_speed, speed in zip(self._wind_setters, wind_ned_m_s, strict=True):
            set_speed(speed / _METRES_PER_FOOT)

    def _start(
        self, airframe: Airframe, latitude_deg: float, longitude_deg: float, altitude_m: float,
        yaw_rad: float,
    ) -> None:  # fmt: skip
        fdm = self._fdm
        fdm.set_dt(self._dt_s)
        fdm["ic/lat-geod-deg"] = latitude_deg
        fdm["ic/long-gc-deg"] = longitude_deg
        fdm["ic/terrain-elevation-ft"] = altitude_m / _METRES_PER_FOOT
        fdm["ic/psi-true-deg"] = math.degrees(yaw_rad) % 360.0
        fdm["ic/h-agl-ft"] = airframe.standing_m / _METRES_PER_FOOT
        fdm["atmosphere/turb-type"] = _TURBULENCE_NONE
        if not fdm.run_ic():
            raise PlantError("JSBSim does not start from the initial conditions")

    def _bind(self) -> None:
        """Look up the JSBSim properties that the plant reads and writes in each step."""
        manager = self._fdm.get_property_manager()

        def nodes(*names: str) -> list[Any]:
            properties = [manager.get_node(name) for name in names]
            if any(node is None for node in properties):
                raise PlantError(f"JSBSim has not all of the properties {names}")
            return properties

        def getters(*names: str) -> list[Callable[[], float]]:
            return [node.get_double_value for node in nodes(*names)]

        def setters(*names: str) -> list[Callable[[float], object]]:
            return [node.set_double_value for node in nodes(*names)]

        self._run = self._fdm.run
        self._commands = setters(*(f"fcs/motor{i}-cmd-n" for i in range(MOTORS)))
        self._thrust_getters = getters(*(f"fcs/motor{i}-n" for i in range(MOTORS)))
        self._motion_getters = getters(
            *(f"position/from-start-neu-{axis}-ft" for axis in "neu"),
            *(f"velocities/v-{axis}-fps" for axis in ("north", "east", "down")),
            *(f"attitude/{angle}-rad" for angle in ("phi", "theta", "psi")),
            *(f"velocities/{axis}-rad_sec" for axis in "pqr"),
            *(f"accelerations/a-pilot-{axis}-ft_sec2" for axis in "xyz"),
        )
        self._ground_contact_getters = getters(*(f"gear/unit[{i}]/WOW" for i in range(4)))
        self._wind_setters = setters(
            *(f"atmosphere/wind-{axis}-fps" for axis in ("north", "east", "down"))
        )
