"""The physics of one quadrotor: JSBSim, stepped; thrust commands in, true motion out."""

import math
import os
from typing import Any

from vehicles.embedded.airframe import MOTORS, Airframe, aircraft_root
from vehicles.embedded.states import Motion, Thrusts
from worlds.frames import Vec3, wrap_pi

os.environ.setdefault("JSBSIM_DEBUG", "0")

import jsbsim  # it reads JSBSIM_DEBUG when imported

_METRES_PER_FOOT = 0.3048
_TURBULENCE_NONE = 0.0


class PlantError(Exception):
    """The physics cannot go on; says in which quantity."""


class _Silent(jsbsim.FGLogger):
    """Takes JSBSim's messages and drops them: it writes to stdout otherwise."""

    def set_level(self, level: object) -> None:
        pass

    def file_location(self, filename: object, line: object) -> None:
        pass

    def message(self, message: object) -> None:
        pass

    def format(self, format: object) -> None:  # noqa: A002  # JSBSim's name
        pass

    def flush(self) -> None:
        pass


class Plant:
    """One JSBSim quadrotor that stands on flat ground, its heading and place given.

    `motor_factors` multiply the commanded thrusts: the spread between motors. Positions are NED
    metres from where it stands after settling.
    """

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
        jsbsim.set_logger(_Silent())
        root = aircraft_root(airframe, motor_lag_s=motor_lag_s)
        fdm = self._fdm = jsbsim.FGFDMExec(str(root))
        fdm.set_debug_level(0)
        if not fdm.load_model("quadx"):
            raise PlantError(f"JSBSim does not take the aircraft below {root}")
        self._factors = list(motor_factors)
        self._dt_s = 1.0 / rate_hz
        self._start(airframe, latitude_deg, longitude_deg, altitude_m, yaw_rad)
        self._bind()
        self._zero: Vec3 = (0.0, 0.0, 0.0)
        self._settle()

    def step(self, thrusts: Thrusts) -> None:
        """Advance by one step with these commands, in newtons per motor."""
        factors = self._factors
        a, b, c, d = self._commands
        a.set_double_value(thrusts[0] * factors[0])
        b.set_double_value(thrusts[1] * factors[1])
        c.set_double_value(thrusts[2] * factors[2])
        d.set_double_value(thrusts[3] * factors[3])
        self._fdm.run()

    def motion(self) -> Motion:
        """Return the true motion. Raises PlantError when a number is not finite."""
        n, e, u = self._position
        zero = self._zero
        position = (
            n.get_double_value() * _METRES_PER_FOOT - zero[0],
            e.get_double_value() * _METRES_PER_FOOT - zero[1],
            -u.get_double_value() * _METRES_PER_FOOT - zero[2],
        )
        vn, ve, vd = self._velocity
        velocity = (
            vn.get_double_value() * _METRES_PER_FOOT,
            ve.get_double_value() * _METRES_PER_FOOT,
            vd.get_double_value() * _METRES_PER_FOOT,
        )
        roll, pitch, yaw = self._attitude
        euler = (
            roll.get_double_value(),
            pitch.get_double_value(),
            wrap_pi(yaw.get_double_value()),
        )
        p, q, r = self._rates
        rates = (p.get_double_value(), q.get_double_value(), r.get_double_value())
        x, y, z = self._forces
        force = (
            x.get_double_value() * _METRES_PER_FOOT,
            y.get_double_value() * _METRES_PER_FOOT,
            z.get_double_value() * _METRES_PER_FOOT,
        )
        everything = position[0] + position[1] + position[2] + velocity[0] + velocity[1]
        everything += velocity[2] + euler[0] + euler[1] + euler[2] + rates[0] + rates[1] + rates[2]
        if not math.isfinite(everything):
            raise PlantError(
                f"the physics left the finite numbers: position {position}, "
                f"velocity {velocity}, attitude {euler}, rates {rates}"
            )
        return Motion(position, velocity, euler, rates, force)

    def thrusts(self) -> Thrusts:
        """Return what each motor gives now, in newtons: behind its command by the lag."""
        a, b, c, d = self._given
        return (
            a.get_double_value(),
            b.get_double_value(),
            c.get_double_value(),
            d.get_double_value(),
        )

    def on_ground(self) -> bool:
        """Return whether a leg touches the ground."""
        return any(wheel.get_double_value() > 0.0 for wheel in self._wheels)

    def set_wind(self, wind_ned_m_s: Vec3) -> None:
        """Set the movement of the air, towards north, east and down."""
        for node, speed in zip(self._wind, wind_ned_m_s, strict=True):
            node.set_double_value(speed / _METRES_PER_FOOT)

    def fail_motor(self, index: int, *, factor: float = 0.0) -> None:
        """Let one motor give only this part of its commanded thrust from now on."""
        self._factors[index] = factor

    def _start(
        self, airframe: Airframe, latitude_deg: float, longitude_deg: float, altitude_m: float,
        yaw_rad: float,
    ) -> None:  # fmt: skip
        fdm = self._fdm
        fdm.set_dt(self._dt_s)
        standing_m = airframe.leg_height_m - airframe.hover_thrust_n / airframe.leg_stiffness_n_m
        fdm["ic/lat-geod-deg"] = latitude_deg
        fdm["ic/long-gc-deg"] = longitude_deg
        fdm["ic/terrain-elevation-ft"] = altitude_m / _METRES_PER_FOOT
        fdm["ic/psi-true-deg"] = math.degrees(yaw_rad) % 360.0
        fdm["ic/h-agl-ft"] = standing_m / _METRES_PER_FOOT
        fdm["atmosphere/turb-type"] = _TURBULENCE_NONE
        if not fdm.run_ic():
            raise PlantError("JSBSim does not start from the initial conditions")

    def _bind(self) -> None:
        manager = self._fdm.get_property_manager()

        def nodes(*names: str) -> list[Any]:
            found = [manager.get_node(name) for name in names]
            if any(node is None for node in found):
                raise PlantError(f"JSBSim lacks a property of {names}")
            return found

        self._commands = nodes(*(f"fcs/motor{i}-cmd-n" for i in range(MOTORS)))
        self._given = nodes(*(f"fcs/motor{i}-n" for i in range(MOTORS)))
        self._position = nodes(*(f"position/from-start-neu-{axis}-ft" for axis in "neu"))
        self._velocity = nodes(*(f"velocities/v-{axis}-fps" for axis in ("north", "east", "down")))
        self._attitude = nodes(*(f"attitude/{angle}-rad" for angle in ("phi", "theta", "psi")))
        self._rates = nodes(*(f"velocities/{axis}-rad_sec" for axis in "pqr"))
        self._forces = nodes(*(f"accelerations/a-pilot-{axis}-ft_sec2" for axis in "xyz"))
        self._wheels = nodes(*(f"gear/unit[{i}]/WOW" for i in range(4)))
        self._wind = nodes(*(f"atmosphere/wind-{axis}-fps" for axis in ("north", "east", "down")))

    def _settle(self) -> None:
        """Let the legs find their rest, then count positions from there."""
        for _ in range(round(0.5 / self._dt_s)):
            self.step((0.0, 0.0, 0.0, 0.0))
        self._zero = self.motion().position_ned_m
