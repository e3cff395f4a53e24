"""An IMU: white noise, turn-on biases and random-walk biases."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from wil_campaign.plugins.navigation.gauss_markov import GaussMarkovWalk
from wil_campaign.vehicles.readings import ImuReading, Source
from wil_campaign.vehicles.readings.faults import ReadingFault, are_reading_numbers_finite
from wil_campaign.vehicles.readings.messages import (
    VECTOR3,
    Json,
    stamped_message_schema,
    vector_from_json,
)
from wil_campaign.vehicles.readings.traits import Encoded, Parts, ReadingTraits
from wil_campaign.vehicles.sensors.noise_sets import NoiseSets
from wil_campaign.vehicles.sensors.sensor_spec import (
    SensorOptions,
    SensorSite,
    SensorSpec,
    TruthRate,
)
from wil_campaign.vehicles.sensors.timing import Timing
from wil_campaign.vehicles.sensors.truth import Truth
from wil_campaign.worlds.frames import (
    Pose,
    Vec3,
    add,
    angle_between,
    norm,
    quat_conjugate,
    rotate,
    scale,
)
from wil_campaign.worlds.geodesy import LocalFrame

_G_M_S2 = 9.80665
_G_FACTOR = 2.0
"""An accelerometer at rest measures gravity within a few per cent."""
_ASIDE_RAD = math.radians(45.0)
_STILL_RAD_S = 0.35
"""20 deg/s: a gyroscope at rest reports less; one in deg/s for rad/s exceeds it by its noise."""
_SPAN_S = 0.5
"""Over so long a stretch attitude and rates are compared, whatever clock each is stamped by."""
_LONGEST_STEP_S = 0.1
"""Rates are not known over a longer gap."""
_TIMES = 10.0
"""A unit or a scale that is wrong is off by more; a clock or a vibration by less."""
_NOISE_RAD, _TURNED_RAD = 0.5, 0.2
"""A turn that is no noise of a gyroscope; of an attitude."""
_STRETCHES = 4
"""So many contradict each other before a sensor is called wrong: an attitude may step."""


@dataclass(frozen=True, slots=True)
class ImuNoise:
    """The noise of an IMU's gyroscope and accelerometer, each axis.

    The defaults are those of the ADIS16448 as RotorS and PX4's Gazebo models use them (Furrer,
    Burri, Achtelik and Siegwart, "RotorS", 2016, IMU plugin). Densities in (rad/s)/sqrt(Hz) and
    (m/s^2)/sqrt(Hz); random walks in (rad/s^2)/sqrt(Hz) and (m/s^3)/sqrt(Hz); times in s;
    turn-on biases are standard deviations in rad/s and m/s^2.
    """

    gyro_density: float = math.radians(2.0 * 35.0 / 3600.0)
    gyro_random_walk: float = math.radians(2.0 * 4.0 / 3600.0)
    gyro_bias_time_s: float = 1000.0
    gyro_turn_on_rad_s: float = math.radians(0.5)
    accel_density: float = 2.0 * 2.0e-3
    accel_random_walk: float = 2.0 * 3.0e-3
    accel_bias_time_s: float = 300.0
    accel_turn_on_m_s2: float = 20.0e-3 * 9.8


NO_IMU_NOISE = ImuNoise(
    gyro_density=0.0,
    gyro_random_walk=0.0,
    gyro_turn_on_rad_s=0.0,
    accel_density=0.0,
    accel_random_walk=0.0,
    accel_turn_on_m_s2=0.0,
)
IMU_NOISES = NoiseSets(ideal=NO_IMU_NOISE, datasheet=ImuNoise())

IMU_TIMING = Timing(rate_hz=200.0)
"""PX4 publishes its filtered IMU at 200 Hz by default (IMU_INTEG_RATE)."""


class ImuSensor:
    """An IMU in the body's origin, axes FRD; keeps its count and its biases."""

    def __init__(
        self, *, source: Source, noise: ImuNoise = NO_IMU_NOISE, timing: Timing = IMU_TIMING
    ) -> None:
        self.timing = timing
        self._source = source
        self._noise = noise
        per_sample = math.sqrt(timing.rate_hz)
        self._gyro_sigma = noise.gyro_density * per_sample
        self._accel_sigma = noise.accel_density * per_sample
        # A random walk w with time constant tau has the stationary deviation w sqrt(tau / 2).
        gyro = noise.gyro_random_walk * math.sqrt(noise.gyro_bias_time_s / 2.0)
        accel = noise.accel_random_walk * math.sqrt(noise.accel_bias_time_s / 2.0)
        self._gyro_walk = GaussMarkovWalk(sigma=(gyro,) * 3, time_constant_s=noise.gyro_bias_time_s)
        self._accel_walk = GaussMarkovWalk(
            sigma=(accel,) * 3, time_constant_s=noise.accel_bias_time_s
        )
        self._turn_on: list[float] | None = None
        self._silent = noise == NO_IMU_NOISE
        self._seq = 0

    def sample(self, truth: Truth, t_s: float, rng: np.random.Generator) -> ImuReading:
        """Return the IMU reading at t_s."""
        force, rates = truth.specific_force_frd_m_s2, truth.rates_frd_rad_s
        if not self._silent:
            force, rates = self._add_noise(force, rates, t_s, rng)
        self._seq += 1
        arrived_s = self.timing.arrival_s(t_s, rng)
        return ImuReading(t_s, arrived_s, self._seq - 1, self._source, force, rates)

    def _add_noise(
        self, force: Vec3, rates: Vec3, t_s: float, rng: np.random.Generator
    ) -> tuple[Vec3, Vec3]:
        if self._turn_on is None:
            self._turn_on = rng.standard_normal(6).tolist()
        on, n = self._turn_on, rng.standard_normal(6).tolist()
        b, g = self._accel_walk.at(t_s, rng), self._gyro_walk.at(t_s, rng)
        a_on, a_white = self._noise.accel_turn_on_m_s2, self._accel_sigma
        g_on, g_white = self._noise.gyro_turn_on_rad_s, self._gyro_sigma
        return (
            (
                force[0] + a_on * on[0] + b[0] + a_white * n[0],
                force[1] + a_on * on[1] + b[1] + a_white * n[1],
                force[2] + a_on * on[2] + b[2] + a_white * n[2],
            ),
            (
                rates[0] + g_on * on[3] + g[0] + g_white * n[3],
                rates[1] + g_on * on[4] + g[1] + g_white * n[4],
                rates[2] + g_on * on[5] + g[2] + g_white * n[5],
            ),
        )


class ImuOptions(SensorOptions):
    """An IMU among a vehicle's sensors: accelerometer and gyroscope.

    rate_hz: samples in a second.
    """

    embedded_only: ClassVar[bool] = True
    rate_hz: TruthRate = 200.0


def _model(options: ImuOptions, site: SensorSite) -> ImuSensor:
    noise = IMU_NOISES.named(site.noise)
    return ImuSensor(source=site.side, noise=noise, timing=Timing(options.rate_hz))


def _fault(reading: ImuReading) -> ReadingFault | None:
    """Check an IMU reading; return its fault or None."""
    numbers = (*reading.specific_force_frd_m_s2, *reading.rates_frd_rad_s)
    if not are_reading_numbers_finite(numbers):
        return ReadingFault("not_finite", f"specific force and rates {numbers}")
    return None


def _encode(reading: ImuReading) -> Encoded:
    """Return an IMU reading as the fields of a wil.Imu."""
    force, rates = reading.specific_force_frd_m_s2, reading.rates_frd_rad_s
    return {
        "linear_acceleration": dict(zip("xyz", force, strict=True)),
        "angular_velocity": dict(zip("xyz", rates, strict=True)),
    }, None


def _decode(document: Json, _: Parts) -> dict[str, Any]:
    force, rates = document["linear_acceleration"], document["angular_velocity"]
    return {
        "specific_force_frd_m_s2": vector_from_json([force[axis] for axis in "xyz"]),
        "rates_frd_rad_s": vector_from_json([rates[axis] for axis in "xyz"]),
    }


def _rest_fault(reading: ImuReading, pose: Pose, _: LocalFrame) -> str | None:
    force = reading.specific_force_frd_m_s2
    size = norm(force)
    if not _G_M_S2 / _G_FACTOR < size < _G_M_S2 * _G_FACTOR:
        return (
            f"its specific force at rest is {size:.4g}, not {_G_M_S2:.1f} m/s2: its unit is wrong"
        )
    expected = rotate(quat_conjugate(pose.q_wxyz), (0.0, 0.0, -_G_M_S2))
    cos = sum(a * b for a, b in zip(force, expected, strict=True)) / (size * _G_M_S2)
    if cos < math.cos(_ASIDE_RAD):
        parts = ", ".join(f"{part:.2f}" for part in force)
        return (
            f"its specific force at rest is ({parts}), not about (0, 0, -9.81) m/s2: its axes are "
            "not forward, right, down"
        )
    rate = norm(reading.rates_frd_rad_s)
    if rate > _STILL_RAD_S:
        return f"its rate at rest is {rate:.3g} rad/s: its unit is wrong, or the vehicle moves"
    return None


class TurnCheck:
    """Compares the turns of a gyroscope with those of its vehicle's attitude, in stretches."""

    def __init__(self) -> None:
        self._begin: tuple[float, Pose] | None = None
        self._last_s = -math.inf
        self._turn_rad: Vec3 = (0.0, 0.0, 0.0)
        self._wrong = 0
        self._text: str | None = None

    def receive(self, reading: ImuReading, pose: Pose) -> str | None:
        """Return what is wrong with a gyroscope, in words; None for nothing."""
        step_s, self._last_s = reading.t_s - self._last_s, reading.t_s
        if self._begin is None or not 0.0 < step_s <= _LONGEST_STEP_S:
            self._restart(reading, pose)
            return self._text
        self._turn_rad = add(self._turn_rad, scale(reading.rates_frd_rad_s, step_s))
        since_s, before = self._begin
        if reading.t_s - since_s >= _SPAN_S:
            self._compare(norm(self._turn_rad), angle_between(before.q_wxyz, pose.q_wxyz))
            self._restart(reading, pose)
        return self._text

    def _restart(self, reading: ImuReading, pose: Pose) -> None:
        self._begin, self._turn_rad = (reading.t_s, pose), (0.0, 0.0, 0.0)

    def _compare(self, by_rates_rad: float, turned_rad: float) -> None:
        too_far = by_rates_rad > _NOISE_RAD + _TIMES * turned_rad
        too_little = turned_rad > _TURNED_RAD + _TIMES * by_rates_rad
        self._wrong += too_far or too_little
        if self._wrong < _STRETCHES or self._text is not None:
            return
        by, turned = math.degrees(by_rates_rad), math.degrees(turned_rad)
        self._text = (
            f"its rates turn by {by:.3g} deg within {_SPAN_S:g} s where the vehicle turned by "
            f"{turned:.2g} deg: their unit is wrong (rad/s is expected), or their scale"
        )


_TRAITS = ReadingTraits(
    fault=_fault,
    schema=stamped_message_schema("wil.Imu", linear_acceleration=VECTOR3, angular_velocity=VECTOR3),
    encode=_encode,
    decode=_decode,
    compared=lambda r: (*r.specific_force_frd_m_s2, *r.rates_frd_rad_s),
    at_rest=_rest_fault,
    in_flight=lambda: TurnCheck().receive,
    overlaid=True,
    quantities={
        "force_m_s2": lambda r: norm(r.specific_force_frd_m_s2),
        "rate_rad_s": lambda r: norm(r.rates_frd_rad_s),
    },
)
IMU = SensorSpec(
    "imu",
    ImuReading,
    ImuOptions,
    _model,
    traits=_TRAITS,
    mavlink="wil_campaign.plugins.navigation.imu_messages:MESSAGES",
)
