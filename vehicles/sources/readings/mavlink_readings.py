"""Readings in a vehicle's MAVLink messages, stamped on the run clock."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from wil_campaign.vehicles.clocks.timesync import VehicleClock
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample, VehicleState
from wil_campaign.vehicles.mavlink.names import message_number
from wil_campaign.vehicles.readings import GpsReading, PoseReading, Reading, Source
from wil_campaign.vehicles.sources.arrival_clock import ArrivalClock
from wil_campaign.vehicles.sources.readings.live_readings import LiveReadings, UnusableReadingError
from wil_campaign.vehicles.sources.readings.mavlink_messages import (
    UNSTATED,
    Beams,
    StatedReach,
    Times,
    gps_reading,
    imu_reading,
    lidar_reading,
    rangefinder_reading,
    stamp_s,
)
from wil_campaign.worlds.frames import AT_ORIGIN, Pose

Handler = Callable[[Any, float], None]
_EARLIER_S = 1e-6


class MavlinkVehicle(Protocol):
    """The part of a vehicle's driver that MAVLink readings need (protocol)."""

    clock: VehicleClock
    """The vehicle's clock, mapped by TIMESYNC."""

    @property
    def state(self) -> VehicleState:
        """Return the vehicle's last reported state."""

    def on_message(self, message_id: int, handler: Handler) -> None:
        """Call `handler` with each of the vehicle's messages and its time of arrival."""

    def on_estimate(self, listener: Callable[[EstimateSample], None]) -> None:
        """Call `listener` with each estimate of the vehicle in the world."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MavlinkSensor:
    """A sensor whose readings are in one of the vehicle's MAVLink messages.

    message: its name; None for a pose, which is the vehicle's estimate. rate_hz: at most; None:
    as it arrives. mount, reach, sensor_id: of ranging sensors; beams: of a lidar. undulation_m: of
    the geoid above the ellipsoid, for a GPS receiver that does not report it.
    """

    message: str | None
    rate_hz: float | None = None
    mount: Pose = AT_ORIGIN
    reach: StatedReach = UNSTATED
    sensor_id: int | None = None
    beams: Beams | None = None
    undulation_m: float | None = None


class MavlinkReadings:
    """Feeds a live source with the readings of one of a vehicle's MAVLink messages.

    A stamp since boot is mapped as telemetry's are (decision 0004); one since 1970 by its least
    delay.
    """

    def __init__(self, *, sensor: MavlinkSensor, side: Source, into: LiveReadings) -> None:
        self._sensor = sensor
        self._side: Source = side
        self._into = into
        self._unix = ArrivalClock()
        self._previous_fix: GpsReading | None = None
        self._due_s = 0.0

    def attach(self, vehicle: MavlinkVehicle) -> None:
        """Take the vehicle's messages from now on; before it is identified."""
        self._vehicle = vehicle
        if self._sensor.message is None:
            vehicle.on_estimate(self._receive_estimate)
            return
        vehicle.on_message(message_number(self._sensor.message), self._receive)

    def _receive(self, message: Any, arrived_s: float) -> None:
        try:
            reading = self._reading(message, arrived_s)
        except UnusableReadingError as error:
            self._into.refuse(str(error))
            return
        if reading is not None:
            self._into.offer(reading)

    def _receive_estimate(self, sample: EstimateSample) -> None:
        rate_hz = self._sensor.rate_hz
        if sample.t_s < self._due_s - _EARLIER_S:
            return
        self._due_s = max(self._due_s + (1.0 / rate_hz if rate_hz else 0.0), sample.t_s)
        pose = PoseReading(
            t_s=sample.t_s,
            arrived_s=sample.arrived_s,
            source=self._side,
            pose=sample.pose,
            velocity_ned_m_s=sample.velocity_ned_m_s,
        )
        self._into.offer(pose)

    def _reading(self, message: Any, arrived_s: float) -> Reading | None:
        """Return the reading in a message; None for another sensor's."""
        sensor, times = self._sensor, self._times(message, arrived_s)
        if sensor.message == "DISTANCE_SENSOR":
            return rangefinder_reading(
                message, times, mount=sensor.mount, reach=sensor.reach, sensor_id=sensor.sensor_id
            )
        if sensor.beams is not None:
            local = self._vehicle.state.local
            return lidar_reading(
                message,
                times,
                pattern=sensor.beams,
                mount=sensor.mount,
                reach=sensor.reach,
                heading_rad=None if local is None else local.pose.yaw_rad,
            )
        if sensor.message in {"GPS_RAW_INT", "GPS2_RAW"}:
            before = self._previous_fix
            self._previous_fix = fix = gps_reading(
                message, times, before=before, undulation_m=sensor.undulation_m
            )
            return fix if before is not None else None
        return imu_reading(message, times)

    def _times(self, message: Any, arrived_s: float) -> Times:
        """Return a message's times on the run clock. Raises UnusableReadingError."""
        sent_s, is_unix = stamp_s(message)
        if is_unix:
            return Times(self._unix.run_time(sent_s, arrived_s), arrived_s, self._side)
        try:
            t_s = self._vehicle.clock.run_time(sent_s)
        except ValueError as error:
            raise UnusableReadingError(str(error)) from error
        # Sampling is before arrival: within the clock map's uncertainty a later stamp is reduced.
        uncertainty_s = self._vehicle.clock.uncertainty_s or 0.0
        return Times(min(t_s, max(arrived_s, t_s - uncertainty_s)), arrived_s, self._side)
