"""External readings of sensors other than cameras: opened, checked at rest, watched for stalls."""

import asyncio
from collections.abc import Callable, Iterable
from contextlib import AsyncExitStack
from typing import Any

from wil_campaign.campaigns.values.external_setups import ReadingSourceSetup
from wil_campaign.campaigns.values.sensor_setups import DepthSetup, OtherSensorSetup, SourcedSetup
from wil_campaign.hooks import sources
from wil_campaign.installed_plugins import load_plugin_object, plugin_additions
from wil_campaign.orchestrator.external.external_sources import ExternalSource
from wil_campaign.orchestrator.run_results.result_parts import SourceResult
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.vehicles.driver.session.repeater import Repeater
from wil_campaign.vehicles.readings import Reading, Source
from wil_campaign.vehicles.readings.checks import reading_rest_fault
from wil_campaign.vehicles.sources.camera_source import ReadingSource, SourceError
from wil_campaign.vehicles.sources.readings.live_readings import LiveReadings
from wil_campaign.vehicles.sources.readings.mavlink_messages import MavlinkSensor, mavlink_reading
from wil_campaign.vehicles.sources.readings.mavlink_readings import MavlinkReadings
from wil_campaign.vehicles.sources.readings.recorded_readings import ReadingFile, RecordedReadings
from wil_campaign.vehicles.sources.source_request import SourceRequest
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.geodesy import LocalFrame

_POLL_S = 0.05
_REQUEST_AGAIN_S = 1.0
"""A radio of 57600 baud carries some 100 requests a second, beside the telemetry."""
_ESTIMATE = "LOCAL_POSITION_NED with ATTITUDE_QUATERNION"
_OTHER_REMEDY = "let the autopilot send it on this link, or name another by `message`"


class ExternalReadings(ExternalSource):
    """One sensor of a vehicle with external readings; a Stream of them."""

    def __init__(self, *, sensor: SourcedSetup, source: ReadingSourceSetup, side: Source) -> None:
        super().__init__(
            sensor=sensor.name, shown_as=source.shown_as, side=side, make=self._make_source
        )
        self._setup = sensor
        self._mount, self._camera = _mount_and_camera(sensor)
        self._from_setup = source
        self._live = self._make_live()

    def attach(self, context: VehicleContext) -> None:
        """Attach the vehicle whose sensor this is; before it is identified."""
        super().attach(context)
        if self._from_setup.kind == "mavlink":
            feed = MavlinkReadings(
                sensor=self._mavlink_sensor(),
                side=self._side,
                into=self._live,
                read=mavlink_reading(self._setup.kind),
            )
            feed.attach(context.driver)

    async def ready(self, *, frame: LocalFrame | None) -> None:
        """Wait for a reading, and check that it fits a vehicle at rest. Raises SourceError.

        frame: of the world on earth; None where the recipe converts units or axes of this sensor,
        so that they cannot be checked here.
        """
        self.is_converted = frame is None
        if self._from_setup.shown_as == "file" or self._context is None:
            return
        loop = asyncio.get_running_loop()
        since_s = loop.time()
        requests = Repeater(period_s=_REQUEST_AGAIN_S, action=self._context.driver.request_missing)
        if self._from_setup.kind == "mavlink":
            requests.start()
        try:
            while self._live.newest is None or self._live.newest.arrived_s < since_s:
                if loop.time() > since_s + self._from_setup.open_s:
                    raise SourceError(self._live.missing_reading_text(self._from_setup.open_s))
                await asyncio.sleep(_POLL_S)
        finally:
            requests.stop()
        pose = self._context.poses.at(loop.time()).pose
        if frame is None or pose is None:
            return
        fault = reading_rest_fault(self._live.newest, pose=pose, frame=frame)
        if fault is not None:
            raise SourceError(f"{self._live.name}: {fault}")

    def _make_source(self) -> ReadingSource[Reading]:
        source = self._from_setup
        if source.shown_as == "live":
            return self._live
        file: ReadingFile = self._made_by_plugin()
        return RecordedReadings(file=file, side=self._side, latency_s=source.latency_s)

    def _made_by_plugin(self) -> Any:
        sensor, source = self._setup, self._from_setup
        return load_plugin_object(plugin_additions(sources)[source.kind].open)(
            SourceRequest(
                address=source.address,
                sensor=source.name,
                kind=sensor.kind,
                side=self._side,
                mount=self._mount,
                camera=self._camera,
                rate_hz=sensor.rate_hz,
                topic=source.topic or "",
                latency_s=source.latency_s,
                open_s=source.open_s,
                stall_s=source.stall_s,
            )
        )

    def _make_live(self) -> LiveReadings:
        sensor, source = self._setup, self._from_setup
        if source.kind != "mavlink" and source.shown_as == "live":
            live: LiveReadings = self._made_by_plugin()
            return live
        read = mavlink_reading(sensor.kind)
        return LiveReadings(
            name=f"{self._side} {sensor.name} from {source.address}",
            what=source.message or _ESTIMATE,
            stall_s=source.stall_s,
            remedy=({} if read is None else read.remedies).get(source.message or "", _OTHER_REMEDY),
        )

    def _mavlink_sensor(self) -> MavlinkSensor:
        """Return how the sensor's MAVLink messages are read."""
        sensor, source = self._setup, self._from_setup
        return MavlinkSensor(
            message=source.message,
            rate_hz=sensor.rate_hz,
            options=sensor.options if isinstance(sensor, OtherSensorSetup) else None,
            mount=self._mount,
            sensor_id=source.sensor_id,
            undulation_m=source.undulation_m,
        )


def _mount_and_camera(sensor: SourcedSetup) -> tuple[Pose, Intrinsics | None]:
    """Return a sensor's pose in the body's FRD frame, and the model of a depth camera."""
    if isinstance(sensor, DepthSetup):
        return sensor.mount.pose, sensor.intrinsics
    return sensor.mount, None


class ReadingSources:
    """All sensors of a run with external readings, except cameras."""

    def __init__(self, setup: RunSetup) -> None:
        self._frame = setup.case.world.frame
        self._converted = _converted_sensors(setup)
        self._by_key = {
            (str(vehicle.name), sensor.name): ExternalReadings(
                sensor=sensor, source=source, side=vehicle.name
            )
            for vehicle in setup.with_sensors
            for sensor, source in vehicle.sourced
        }

    def __len__(self) -> int:
        """Return the number of sensors."""
        return len(self._by_key)

    def get(self, vehicle: str, sensor: str) -> ExternalReadings | None:
        """Return a vehicle's sensor with external readings; None where it has none."""
        return self._by_key.get((vehicle, sensor))

    async def open(self, stack: AsyncExitStack) -> None:
        """Open all sources of readings. Raises SourceError."""
        for readings in self._by_key.values():
            await readings.open(stack)

    def attach(self, contexts: Iterable[VehicleContext]) -> None:
        """Attach the vehicles whose sensors these are; before they are identified."""
        there = {context.name: context for context in contexts}
        for (vehicle, _), readings in self._by_key.items():
            if vehicle in there:
                readings.attach(there[vehicle])

    def on_stall(self, stalled: Callable[[str], None]) -> None:
        """Call `stalled` with the reason whenever a sensor delivers nothing usable."""
        for readings in self._by_key.values():
            readings.on_stall(stalled)

    async def ready(self) -> str:
        """Wait until each has a reading; return in words what was checked. Raises SourceError."""
        for (_, sensor), readings in self._by_key.items():
            await readings.ready(frame=None if sensor in self._converted else self._frame)
        return ", ".join(" ".join(key) for key in self._by_key)

    @property
    def results(self) -> tuple[SourceResult, ...]:
        """Return the counts of each source of readings."""
        return tuple(readings.result for readings in self._by_key.values())


def _converted_sensors(setup: RunSetup) -> frozenset[str]:
    """Return the sensors whose units or axes the recipe converts."""
    recipe = setup.case.recipe
    return frozenset(
        combination.sensor.name
        for combination in (() if recipe is None else recipe.combinations)
        if any(step.kind.name in {"units", "axes"} for step in combination.steps)
    )
