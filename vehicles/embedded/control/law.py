"""A firmware's control law: its gains by parameters, its state, and its compiled step."""

import math
import struct
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from wil_campaign.vehicles.embedded.control import px4_kernel
from wil_campaign.vehicles.embedded.control.kernels import (
    AIRFRAME,
    GAINS,
    LAW_NUMBERS,
    STATE,
    STEP_S,
    TARGET,
    THRUSTS,
)
from wil_campaign.vehicles.embedded.control.target import ControlTarget
from wil_campaign.vehicles.embedded.physics.airframe import Airframe
from wil_campaign.vehicles.embedded.physics.motion_kernel import NO_LAW, Advance
from wil_campaign.vehicles.poses.truth import Thrusts
from wil_campaign.worlds.frames import Vec3
from wil_campaign.worlds.jit import F64, kernel_dispatcher

_OUTER_STEPS = 2
"""The position part runs every second step, 125 Hz."""
_HEADING = 9
_TARGET = struct.Struct("12d")
"""Packed into an array, in a quarter of the time of an assignment."""
_MAX_GAIN, _MIN_DIVISOR = 1e4, 1e-3
_DIVISORS = frozenset({"MPC_XY_VEL_P_ACC", "MOT_THST_HOVER", "WPNAV_ACCEL", "WPNAV_ACCEL_Z"})
"""Gains by which a law divides."""
_MAX_TILT_DEG = {"ATC_ANGLE_MAX": 80.0, "MPC_TILTMAX_AIR": 89.0}
"""The largest documented values; at a right angle or more no thrust carries the weight."""
_RATE_GAIN_TIMES_LAG = 0.85
"""Rate loop's gain (1/s) times motor lag in PX4's SIH at default gains: 0.15 * 113.1 * 0.05."""


class LawGains(Protocol):
    """Parameters by name (protocol)."""

    def __getitem__(self, name: str) -> float:
        """Return a parameter's value."""


class ControlLawKind(NamedTuple):
    """A firmware's law: its step, and the step of a body that it flies (kernels), its gains.

    authority_rad_s2: angular acceleration per normalised torque, per axis.

    The rate gains act on normalised torque, and `authority_rad_s2` is that of the body in the
    firmware's own simulator. Another airframe is assumed to be tuned: it has the same authority,
    in roll and pitch limited to what its motors' lag allows at `rate_gain`, the default rate gain.
    """

    step: Callable[[F64, F64, int], int]
    advance: Advance
    gains: tuple[str, ...]
    degrees: tuple[str, ...]
    hundredths: tuple[str, ...]
    authority_rad_s2: Vec3
    rate_gain: float

    def authority(self, motor_lag_s: float) -> Vec3:
        """Return the authority about roll, pitch and yaw with motors of this lag."""
        roll, pitch, yaw = self.authority_rad_s2
        most = _RATE_GAIN_TIMES_LAG / (self.rate_gain * motor_lag_s)
        return (min(roll, most), min(pitch, most), yaw)


PX4 = ControlLawKind(
    px4_kernel.step_px4_law,
    px4_kernel.advance_px4_body,
    px4_kernel.GAINS,
    px4_kernel.DEGREES,
    (),
    # SIH: SIH_L_ROLL 0.2 m, SIH_T_MAX 5 N, SIH_Q_MAX 0.1 N m of four motors over SIH_IXX 0.025 and
    # SIH_IZZ 0.030 kg m2; the allocation gives roll and pitch 1/sqrt(2) of the throttle, yaw all.
    (113.1, 113.1, 13.3),
    0.15,
)


class ControlLaw:
    """A firmware's control law: from estimate and target to the thrusts of four motors.

    array: the law's part of the array of the body that it flies; an own one by default.
    """

    def __init__(
        self,
        *,
        kind: ControlLawKind,
        airframe: Airframe,
        dt_s: float,
        parameters: LawGains,
        array: F64 | None = None,
    ) -> None:
        self._kind = kind
        self._step = kernel_dispatcher(kind.step)
        self._array = array = np.zeros(LAW_NUMBERS) if array is None else array
        array[:] = 0.0
        array[STEP_S] = dt_s
        self._state, self._gains = array[STATE], array[GAINS]
        self._target = array[TARGET].data.cast("B")
        self._thrusts = array[THRUSTS]
        array[AIRFRAME] = (
            airframe.mass_kg,
            airframe.inertia_xx_kg_m2,
            airframe.inertia_yy_kg_m2,
            airframe.inertia_zz_kg_m2,
            4.0 * airframe.motor_offset_m,
            4.0 * airframe.torque_per_thrust_m,
            airframe.max_thrust_n,
            *kind.authority(airframe.motor_lag_s),
        )
        self._last_target: ControlTarget | None = None
        self.takes_target = True
        """Whether the next step runs the position part, which reads the target."""
        self.configure(parameters)

    @property
    def yaw_setpoint_rad(self) -> float:
        """Return the law's heading setpoint."""
        return float(self._state[_HEADING])

    def configure(self, parameters: LawGains) -> None:
        """Set the law's gains from parameters.

        A negative one acts as 0, a huge one as the largest that the law can compute with; one that
        is not finite changes nothing. So thrusts are finite, whatever a client sets.
        """
        kind = self._kind
        for place, name in enumerate(kind.gains):
            value = parameters[name]
            if math.isfinite(value):
                value = min(value, _MAX_TILT_DEG.get(name, value))
                value = value / 100.0 if name in kind.hundredths else value
                value = math.radians(value) if name in kind.degrees else value
                least = _MIN_DIVISOR if name in _DIVISORS else 0.0
                self._gains[place] = min(max(value, least), _MAX_GAIN)

    def reset(self, *, yaw_rad: float) -> None:
        """Reset the law's state; hold this heading."""
        self._state[:] = 0.0
        self._state[_HEADING] = yaw_rad
        self.takes_target = True

    def outer_steps(self, target: ControlTarget | None) -> int:
        """Return the outer steps of the law's next step; NO_LAW where this target is new to it."""
        if not self.takes_target:
            return 0
        return _OUTER_STEPS if target is not None and target is self._last_target else NO_LAW

    def run(self, now: F64, target: ControlTarget, *, flown: bool = False) -> Thrusts:
        """Return the law's thrusts of this step; `now` is the estimate's motion array.

        flown: the step of the body has run the law already.
        """
        takes_target = self.takes_target
        self.takes_target = not takes_target
        if not flown:
            if takes_target and target is not self._last_target:
                self._set_target(target)
            self._step(self._array, now, _OUTER_STEPS if takes_target else 0)
        a, b, c, d = self._thrusts.tolist()
        return (a, b, c, d)

    def _set_target(self, target: ControlTarget) -> None:
        (n, e, d), velocity, yaw_rad, rate_rad_s, speeds, direct = target
        self._last_target, nan = target, math.nan
        _TARGET.pack_into(
            self._target,
            0,
            nan if n is None or e is None else n,
            nan if n is None or e is None else e,
            nan if d is None else d,
            *velocity,
            nan if yaw_rad is None else yaw_rad,
            rate_rad_s,
            *speeds,
            1.0 if direct else 0.0,
        )
