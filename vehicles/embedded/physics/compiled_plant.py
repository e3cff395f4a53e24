"""The plant without JSBSim: a compiled rigid body, for machines and searches that it suits."""

import math

import numpy as np

from wil_campaign.vehicles.embedded.physics import rigid_kernel
from wil_campaign.vehicles.embedded.physics.airframe import LEGS, Airframe
from wil_campaign.vehicles.embedded.physics.plant import Plant
from wil_campaign.vehicles.poses.truth import Thrusts
from wil_campaign.worlds.frames import Vec3, quat_from_euler
from wil_campaign.worlds.jit import F64, kernel_dispatcher

_GRIP = 0.5
"""Of a leg that does not slide: the share of its movement that friction takes in a step."""


_LAG_STEP_S = 1.0 / 120.0
"""For which step JSBSim computes the lag of its actuators: its default as it loads the aircraft,
whatever step is set afterwards. At 250 Hz the motors lag by 0.48 of what the profile says."""


class CompiledPlant(Plant):
    """The plant as a compiled rigid body."""

    def __init__(
        self,
        *,
        airframe: Airframe,
        motor_lag_s: float,
        motor_factors: Thrusts,
        latitude_deg: float,
        longitude_deg: float,  # noqa: ARG002 - JSBSim's earth is round
        altitude_m: float,
        yaw_rad: float,
        rate_hz: int,
    ) -> None:
        super().__init__(motor_factors)
        self._dt_s = 1.0 / rate_hz
        self._state = np.zeros(rigid_kernel.STATE)
        self._constants = _constants(airframe, motor_lag_s, latitude_deg, altitude_m, self._dt_s)
        self._state[2] = -airframe.standing_m
        self._state[6:10] = quat_from_euler(0.0, 0.0, yaw_rad)
        self._fly = kernel_dispatcher(rigid_kernel.fly_rigid_body)
        self._settle(self._dt_s)

    def step(self, thrusts: Thrusts, share: float = 1.0) -> None:
        """Advance the plant by one step with a share of these commands, in newtons per motor."""
        (a, b, c, d), (fa, fb, fc, fd) = thrusts, self._factors
        commands = (a * share * fa, b * share * fb, c * share * fc, d * share * fd)
        self._fly(self._state, self._constants, commands, self._dt_s, self._raw)

    def thrusts(self) -> Thrusts:
        """Return each motor's thrust in the plant, newtons: lagging its command."""
        a, b, c, d = self._state[34:38].tolist()
        return (a, b, c, d)

    def on_ground(self) -> bool:
        """Return whether a leg of the plant touches the ground."""
        return bool(self._state[42] > 0.0)

    def set_wind(self, wind_ned_m_s: Vec3) -> None:
        """Set the plant's wind, towards north, east and down."""
        self._state[31:34] = wind_ned_m_s


def _constants(
    a: Airframe, motor_lag_s: float, latitude_deg: float, altitude_m: float, dt_s: float
) -> F64:
    """Return the constants of `rigid_kernel`, by the same terms as the aircraft file."""
    motors = a.motors()
    ratio = _LAG_STEP_S / motor_lag_s
    half_density = 0.5 * _density_kg_m3(altitude_m)
    # So little that friction reverses neither the body's movement nor its turning.
    turned_kg = a.inertia_zz_kg_m2 / (2.0 * a.leg_offset_m**2)
    return np.array(
        [
            a.mass_kg,
            *(a.inertia_xx_kg_m2, a.inertia_yy_kg_m2, a.inertia_zz_kg_m2),
            *(forward for forward, _, _ in motors),
            *(right for _, right, _ in motors),
            *(sign * a.torque_per_thrust_m for _, _, sign in motors),
            *(ratio / (2.0 + ratio), (2.0 - ratio) / (2.0 + ratio)),
            a.max_thrust_n,
            *(half_density * area for area in a.drag_area_m2),
            *(a.min_drag_speed_m_s, a.linear_drag_n_s_m, a.angular_damping_n_m_s),
            *(forward * a.leg_offset_m for forward, _ in LEGS),
            *(right * a.leg_offset_m for _, right in LEGS),
            *(a.leg_stiffness_n_m, a.leg_damping_n_s_m),
            _GRIP * min(a.mass_kg, turned_kg) / (4.0 * dt_s),
            _gravity_m_s2(latitude_deg, altitude_m),
            a.leg_height_m,
        ]
    )


def _density_kg_m3(altitude_m: float) -> float:
    """Return the density of air (International Standard Atmosphere, below 11 km)."""
    return 1.225 * math.pow(1.0 - 2.25577e-5 * altitude_m, 4.25588)


def _gravity_m_s2(latitude_deg: float, altitude_m: float) -> float:
    """Return the acceleration of gravity (WGS 84: Somigliana's formula, less with the height)."""
    square = math.sin(math.radians(latitude_deg)) ** 2
    at_sea_m_s2 = 9.7803253359 * (1.0 + 1.93185265241e-3 * square)
    return at_sea_m_s2 / math.sqrt(1.0 - 6.69437999013e-3 * square) - 3.086e-6 * altitude_m
