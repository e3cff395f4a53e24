"""Flies a vehicle's step responses by its driver, under any clock."""

import asyncio
from collections.abc import Callable

from wil_campaign.plugins.step_response.segments import (
    HEIGHT_M,
    Series,
    StepSample,
    StepSegment,
    step_segments,
)
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample
from wil_campaign.vehicles.errors import StateTimeoutError, VehicleError
from wil_campaign.worlds.frames import euler_from_quat

SETPOINT_HZ = 25
_UP_WITHIN_S = 40.0
_AT_HEIGHT_M = 0.5
_SETTLED_S = 10.0
_LAND_S = 15.0
_DISARMED_WITHIN_S = 60.0
_LOOK_S = 0.05
_READY_WITHIN_S = 120.0
_CLOCK_OFF = 0.1

Progress = Callable[[str], None]
"""Called with the name of each stage and segment when it begins."""


class StepFlight:
    """A flight of step responses of one vehicle, whose driver is entered and identified.

    The world frame is that of its start: it stands at the origin and looks north. A flight that
    ends early raises a VehicleError; the caller then has to land.
    """

    def __init__(self, driver: Driver, *, progress: Progress = lambda _: None) -> None:
        self._driver = driver
        self._progress = progress
        self._samples: list[StepSample] = []
        driver.on_estimate(self._add_sample)

    async def fly(self, segments: tuple[StepSegment, ...] | None = None) -> Series:
        """Arm, take off, fly the segments, land; return the samples of each segment.

        Raises VehicleError.
        """
        await self.take_off()
        flown: Series = {}
        for segment in step_segments() if segments is None else segments:
            self._progress(segment.name)
            flown[segment.name] = await self._stream(segment)
        self._progress("land")
        first = len(self._samples)
        await self._driver.land()
        await asyncio.sleep(_LAND_S)
        flown["land"] = self._samples[first:]
        await self._driver.disarmed(_DISARMED_WITHIN_S)
        return flown

    async def take_off(self) -> None:
        """Arm, take off to the flight's height, and settle there. Raises VehicleError."""
        driver = self._driver
        self._progress("ready")
        await driver.ready(_READY_WITHIN_S)
        self._progress("arm")
        await driver.arm()
        self._progress("takeoff")
        await driver.begin_takeoff(HEIGHT_M)
        await self._at_height()
        await driver.enter_guided()
        (hold,) = (step_segment for step_segment in step_segments() if step_segment.name == "hover")
        await self._stream(hold._replace(seconds=_SETTLED_S))

    async def _at_height(self) -> None:
        """Wait until the takeoff is over. Raises StateTimeoutError."""
        try:
            async with asyncio.timeout(_UP_WITHIN_S):
                while True:
                    state = self._driver.state
                    height_m = -self._samples[-1].down_m if self._samples else 0.0
                    up = abs(height_m - HEIGHT_M) < _AT_HEIGHT_M and state.landed == "in_air"
                    if up and state.mode is not FlightMode.TAKEOFF:
                        return
                    await asyncio.sleep(_LOOK_S)
        except TimeoutError:
            where = f"{-self._samples[-1].down_m:.1f} m" if self._samples else "unknown"
            raise StateTimeoutError(
                f"{self._driver.name}: not at {HEIGHT_M:g} m within {_UP_WITHIN_S:g} s of the "
                f"takeoff command; its height is {where}"
            ) from None

    async def _stream(self, segment: StepSegment) -> list[StepSample]:
        """Send a segment's setpoint for as long as it takes; return its samples."""
        loop, first = asyncio.get_running_loop(), len(self._samples)
        began_s = loop.time()
        for count in range(1, round(segment.seconds * SETPOINT_HZ) + 1):
            self._require_flying(segment)
            self._driver.send(segment.setpoint)
            await asyncio.sleep(max(0.0, began_s + count / SETPOINT_HZ - loop.time()))
        samples = self._samples[first:]
        if len(samples) < segment.seconds * SETPOINT_HZ:
            raise VehicleError(
                f"{self._driver.name}: {len(samples)} estimates in {segment.seconds:g} s of "
                f"'{segment.name}' are too few to measure; give the link a higher rate"
            )
        flown_s = samples[-1].t_s - samples[0].t_s
        if abs(flown_s / segment.seconds - 1.0) > _CLOCK_OFF:
            raise VehicleError(
                f"{self._driver.name}: its clock ran {flown_s:.1f} s in {segment.seconds:g} s of "
                f"'{segment.name}'; have its simulator run in real time"
            )
        return samples

    def _require_flying(self, segment: StepSegment) -> None:
        """Raise VehicleError when the vehicle has stopped following setpoints."""
        state, name = self._driver.state, self._driver.name
        if not state.link_up:
            raise VehicleError(f"{name}: the link was lost in '{segment.name}'")
        if not state.armed:
            raise VehicleError(f"{name}: the vehicle disarmed in '{segment.name}'")
        if state.mode is not FlightMode.GUIDED:
            raise VehicleError(
                f"{name}: the vehicle changed to {state.mode_name} in '{segment.name}'"
            )

    def _add_sample(self, estimate: EstimateSample) -> None:
        place, velocity = estimate.pose.position_ned_m, estimate.velocity_ned_m_s
        angles = euler_from_quat(estimate.pose.q_wxyz)
        self._samples.append(StepSample(estimate.boot_s, *place, *velocity, *angles))
