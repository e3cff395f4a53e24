"""Readings in a vehicle's MAVLink messages, stamped on the run clock."""

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from wil_campaign.vehicles.clocks.timesync import VehicleClock
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample
from wil_campaign.vehicles.mavlink.names import message_number
from wil_campaign.vehicles.readings import PoseReading, Source
from wil_campaign.vehicles.sources.arrival_clock import ArrivalClock
from wil_campaign.vehicles.sources.readings.live_readings import LiveReadings, UnusableReadingError
from wil_campaign.vehicles.sources.readings.mavlink_messages import (
    HasState,
    MavlinkReading,
    MavlinkSensor,
    MessageTimes,
    Reader,
    message_stamp_s,
)

Handler = Callable[[Any, float], None]
_EARLIER_S = 1e-6


class MavlinkVehicle(HasState, Protocol):
    """The part of a vehicle's driver that MAVLink readings need (protocol)."""

    clock: VehicleClock
    """The vehicle's clock, mapped by TIMESYNC."""

    def on_message(self, message_id: int, handler: Handler) -> None:
        """Call `handler` with each of the vehicle's messages and its time of arrival."""

    def on_estimate(self, listener: Callable[[EstimateSample], None]) -> None:
        """Call `listener` with each estimate of the vehicle in the world."""


class MavlinkReadings:
    """Feeds a live source with the readings of one of a vehicle's MAVLink messages.

    A stamp since boot is mapped as telemetry's are (decision 0004); one since 1970 by its least
    delay. read: how, by its type; None for a pose.
    """

    def __init__(
        self,
        *,
        sensor: MavlinkSensor,
        side: Source,
        into: LiveReadings,
        read: MavlinkReading | None = None,
    ) -> None:
        self._sensor = sensor
        self._read = read
        self._side: Source = side
        self._into = into
        self._unix = ArrivalClock()
        self._due_s = 0.0

    def attach(self, vehicle: MavlinkVehicle) -> None:
        """Take the vehicle's messages from now on; before it is identified."""
        self._vehicle = vehicle
        if self._sensor.message is None or self._read is None:
            vehicle.on_estimate(self._receive_estimate)
            return
        reader = self._read.reader(self._sensor, vehicle)
        receive = partial(self._receive, reader)
        vehicle.on_message(message_number(self._sensor.message), receive)

    def _receive(self, reader: Reader, message: Any, arrived_s: float) -> None:
        try:
            reading = reader(message, self._times(message, arrived_s))
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

    def _times(self, message: Any, arrived_s: float) -> MessageTimes:
        """Return a message's times on the run clock. Raises UnusableReadingError."""
        sent_s, is_unix = message_stamp_s(message)
        if is_unix:
            t_s = self._unix.run_time(sent_s, arrived_s)
            self._into.restarts = self._unix.resets
            return MessageTimes(t_s, arrived_s, self._side)
        clock = self._vehicle.clock
        try:
            t_s = clock.run_time(clock.since_boot(sent_s))
        except ValueError as error:
            raise UnusableReadingError(str(error)) from error
        # Sampling is before arrival: within the clock map's uncertainty a later stamp is reduced.
        uncertainty_s = clock.uncertainty_s or 0.0
        return MessageTimes(min(t_s, max(arrived_s, t_s - uncertainty_s)), arrived_s, self._side)
