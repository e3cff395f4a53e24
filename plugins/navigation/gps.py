"""A GPS receiver: fixes on WGS-84 with latency and a slowly varying error."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from wil_campaign.plugins.navigation.gauss_markov import GaussMarkovWalk
from wil_campaign.vehicles.readings import GpsReading, Source
from wil_campaign.vehicles.readings.faults import ReadingFault, are_reading_numbers_finite
from wil_campaign.vehicles.readings.messages import (
    INTEGER,
    NUMBER,
    Json,
    number_from_json,
    schema_of_array,
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
from wil_campaign.worlds.frames import Pose, norm, subtract
from wil_campaign.worlds.geodesy import LocalFrame

_ORIGIN_M = 10.0
_DEVIATIONS = 5.0
_HEIGHT_M = 1000.0
"""Height error of a fix that is let pass: worlds' altitudes are read off maps and geoids."""
_CEP_PER_SIGMA = math.sqrt(2.0 * math.log(2.0))
"""Half of a circular normal distribution lies within this many standard deviations."""


@dataclass(frozen=True, slots=True)
class GpsNoise:
    """The noise of a GPS fix: standard deviations, each axis.

    Position: u-blox NEO-M8 data sheet (UBX-15031086), 2.5 m CEP; the error wanders with a time
    constant of 60 s, and is twice as large vertically (PX4's Gazebo GPS plugin: random walk 2 and
    4, correlation 60 s). Velocity: 0.05 m/s, same data sheet. White part, from fix to fix: 0.01 m,
    an assumption for a receiver that smooths by the carrier.
    """

    horizontal_sigma_m: float = 2.5 / _CEP_PER_SIGMA
    vertical_sigma_m: float = 2.0 * 2.5 / _CEP_PER_SIGMA
    wander_time_s: float = 60.0
    white_sigma_m: float = 0.01
    velocity_sigma_m_s: float = 0.05


NO_GPS_NOISE = GpsNoise(
    horizontal_sigma_m=0.0, vertical_sigma_m=0.0, white_sigma_m=0.0, velocity_sigma_m_s=0.0
)
GPS_NOISES = NoiseSets(ideal=NO_GPS_NOISE, datasheet=GpsNoise())

GPS_TIMING = Timing(rate_hz=5.0, latency_s=0.11)
"""5 Hz as both autopilots configure an M8; latency 110 ms (PX4's EKF2_GPS_DELAY)."""


class GpsSensor:
    """A GPS receiver in the body's origin; keeps its count and its present error.

    frame: where the world's local frame lies on WGS-84.
    """

    def __init__(
        self,
        *,
        source: Source,
        frame: LocalFrame,
        noise: GpsNoise = NO_GPS_NOISE,
        timing: Timing = GPS_TIMING,
    ) -> None:
        self.timing = timing
        self._source = source
        self._frame = frame
        self._noise = noise
        across, down = noise.horizontal_sigma_m, noise.vertical_sigma_m
        self._walk = GaussMarkovWalk(
            sigma=(across, across, down), time_constant_s=noise.wander_time_s
        )
        self._seq = 0

    def sample(self, truth: Truth, t_s: float, rng: np.random.Generator) -> GpsReading:
        """Return the GPS fix at t_s."""
        noise, (north, east, down) = self._noise, truth.pose.position_ned_m
        walk, n = self._walk.at(t_s, rng), rng.standard_normal(6).tolist()
        white, (vn, ve, vd) = noise.white_sigma_m, truth.velocity_ned_m_s
        place = self._frame.to_geodetic(
            (
                north + walk[0] + white * n[0],
                east + walk[1] + white * n[1],
                down + walk[2] + white * n[2],
            )
        )
        slip = noise.velocity_sigma_m_s
        self._seq += 1
        return GpsReading(
            t_s=t_s,
            arrived_s=self.timing.arrival_s(t_s, rng),
            seq=self._seq - 1,
            source=self._source,
            latitude_deg=place.latitude_deg,
            longitude_deg=place.longitude_deg,
            altitude_m=place.altitude_m + self._frame.undulation_m,
            velocity_ned_m_s=(vn + slip * n[3], ve + slip * n[4], vd + slip * n[5]),
            horizontal_accuracy_m=noise.horizontal_sigma_m,
            vertical_accuracy_m=noise.vertical_sigma_m,
        )


class GpsOptions(SensorOptions):
    """A GPS receiver among a vehicle's sensors. rate_hz: fixes in a second."""

    rate_hz: TruthRate = 5.0


def _model(options: GpsOptions, site: SensorSite) -> GpsSensor:
    timing = site.timing(GPS_TIMING, options.rate_hz)
    noise = GPS_NOISES.named(site.noise)
    return GpsSensor(source=site.side, frame=site.frame, noise=noise, timing=timing)


def _fault(reading: GpsReading) -> ReadingFault | None:
    """Check a GPS reading; return its fault or None."""
    r = reading
    numbers = (r.latitude_deg, r.longitude_deg, r.altitude_m, *r.velocity_ned_m_s)
    accuracies = (r.horizontal_accuracy_m, r.vertical_accuracy_m)
    if not are_reading_numbers_finite((*numbers, *accuracies)):
        return ReadingFault("not_finite", f"a fix of {numbers}, accuracies {accuracies}")
    if abs(r.latitude_deg) > 90.0 or abs(r.longitude_deg) > 180.0:
        return ReadingFault(
            "out_of_range", f"latitude {r.latitude_deg}, longitude {r.longitude_deg}"
        )
    if min(accuracies) < 0.0:
        return ReadingFault("negative", f"accuracies {accuracies} m")
    return None


def _encode(reading: GpsReading) -> Encoded:
    """Return a fix as the fields of a foxglove.LocationFix."""
    across, up = reading.horizontal_accuracy_m**2, reading.vertical_accuracy_m**2
    return {
        "latitude": reading.latitude_deg,
        "longitude": reading.longitude_deg,
        "altitude": reading.altitude_m,
        "position_covariance": [across, 0.0, 0.0, 0.0, across, 0.0, 0.0, 0.0, up],
        "position_covariance_type": 2,
        "wil": {
            "velocity_ned_m_s": list(reading.velocity_ned_m_s),
            "horizontal_accuracy_m": reading.horizontal_accuracy_m,
            "vertical_accuracy_m": reading.vertical_accuracy_m,
            "fix_type": reading.fix_type,
            "satellites": reading.satellites,
        },
    }, None


def _decode(document: Json, _: Parts) -> dict[str, Any]:
    wil = document["wil"]
    return {
        "latitude_deg": number_from_json(document["latitude"]),
        "longitude_deg": number_from_json(document["longitude"]),
        "altitude_m": number_from_json(document["altitude"]),
        "velocity_ned_m_s": vector_from_json(wil["velocity_ned_m_s"]),
        "horizontal_accuracy_m": number_from_json(wil["horizontal_accuracy_m"]),
        "vertical_accuracy_m": number_from_json(wil["vertical_accuracy_m"]),
        "fix_type": wil["fix_type"],
        "satellites": wil["satellites"],
    }


def _rest_fault(reading: GpsReading, pose: Pose, frame: LocalFrame) -> str | None:
    altitude_m = reading.altitude_m - frame.undulation_m
    place = frame.to_ned(reading.latitude_deg, reading.longitude_deg, altitude_m)
    north_m, east_m, down_m = subtract(place, pose.position_ned_m)
    apart_m = math.hypot(north_m, east_m)
    limit_m = _ORIGIN_M + _DEVIATIONS * reading.horizontal_accuracy_m
    if apart_m <= limit_m and abs(down_m) <= _HEIGHT_M:
        return None
    return (
        f"its fix ({reading.latitude_deg:.6f}, {reading.longitude_deg:.6f}, "
        f"{reading.altitude_m:.0f} m) is {apart_m:.4g} m beside and {abs(down_m):.4g} m above or "
        "below the vehicle's place in the world: give the world's origin the latitude, longitude, "
        "altitude and undulation_m of this place, or correct the unit"
    )


_TRAITS = ReadingTraits(
    fault=_fault,
    schema=stamped_message_schema(
        "foxglove.LocationFix",
        latitude=NUMBER,
        longitude=NUMBER,
        altitude=NUMBER,
        position_covariance=schema_of_array(NUMBER),
        position_covariance_type=INTEGER,
    ),
    encode=_encode,
    decode=_decode,
    compared=lambda r: (r.latitude_deg, r.longitude_deg, r.altitude_m),
    at_rest=_rest_fault,
    in_world=True,
    overlaid=True,
    quantities={
        "fix_type": lambda r: float(r.fix_type),
        "satellites": lambda r: float(r.satellites),
        "horizontal_accuracy_m": lambda r: r.horizontal_accuracy_m,
        "vertical_accuracy_m": lambda r: r.vertical_accuracy_m,
        "altitude_m": lambda r: r.altitude_m,
        "speed_m_s": lambda r: norm(r.velocity_ned_m_s),
    },
)
GPS = SensorSpec(
    "gps",
    GpsReading,
    GpsOptions,
    _model,
    traits=_TRAITS,
    mavlink="wil_campaign.plugins.navigation.gps_messages:MESSAGES",
)
