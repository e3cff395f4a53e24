"""Sensors of vehicles without a truth: their readings are of the pose at their stamps."""

import asyncio
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.orchestrator.conftest import ROOT
from tests.recipes.samples import beam
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.foundation.clocks.virtual_loop import Clock, run_virtual
from wil_campaign.orchestrator.run.perception.sensor_factory import SensorFactory
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.orchestrator.state.vehicle_context import PoseListener
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.readings import RangefinderReading
from wil_campaign.vehicles.sensors.truth import Truth
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.scene import Scene

NORTH_M_S = 3.0
RANGE = "vehicles.real.sensors.range={type: rangefinder, rate_hz: 20}"
SCAN = "vehicles.real.sensors.scan={type: lidar, rate_hz: 5}"


class NorthSensor:
    """A sensor that measures how far north its vehicle is."""

    def sample(self, truth: Truth, t_s: float, rng: np.random.Generator) -> RangefinderReading:
        del rng
        return replace(beam(truth.pose.position_ned_m[0]), t_s=t_s, arrived_s=t_s)


async def sensed(factory: SensorFactory, setup: RunSetup, telemetry: Any) -> list[Any]:
    """Return what a sensor of the real vehicle delivers while telemetry comes for 3 s."""
    vehicle = setup.vehicle("real")
    (sensor,) = (one for one in vehicle.sensors if one.name == "range")
    stream, taken = factory.stream(vehicle, sensor), list[Any]()
    telemetry()
    task = asyncio.ensure_future(stream.run(taken.append))
    await asyncio.sleep(3.0)
    task.cancel()
    await asyncio.wait([task])
    return taken


def setup_of(folder: Path, *sets: str, clock: Clock) -> RunSetup:
    """Return the set-up of a run whose real vehicle is known by its telemetry."""
    known = ("vehicles.real.link=udpin://127.0.0.1:14540", "vehicles.real.pose_source=mavlink")
    options = ExpansionOptions(cases=("large",), modes=("wil",), sets=(*known, *sets))
    plan = load_campaign(ROOT / "campaigns" / "gate.yaml", options).runs[0]
    return RunSetup.of(RunOrder(plan=plan, folder=folder, clock=clock))


def factory_of(setup: RunSetup, listeners: list[PoseListener]) -> SensorFactory:
    """Return the sensor factory of a real vehicle that is known by its telemetry."""
    context: Any = SimpleNamespace(on_pose=listeners.append)
    external_io: Any = SimpleNamespace(readings=SimpleNamespace(get=lambda *_: None))
    faults: Any = None
    return SensorFactory(
        setup=setup,
        contexts={"real": context},
        feeds={},
        events={},
        external_io=external_io,
        faults=faults,
    )


@pytest.mark.parametrize(("rate_hz", "latency_s"), [(10.0, 0.05), (50.0, 0.02)])
def test_readings_of_a_vehicle_known_by_telemetry_are_of_the_pose_at_their_stamps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rate_hz: float, latency_s: float
) -> None:
    setup = setup_of(tmp_path, RANGE, clock="virtual")
    listeners: list[PoseListener] = []
    factory = factory_of(setup, listeners)
    monkeypatch.setattr(SensorFactory, "_model", lambda *_, **__: NorthSensor())

    def telemetry() -> None:
        for k in range(round(3 * rate_hz)):
            t_s = k / rate_hz
            sample = PoseSample(t_s, "real", Pose.of(NORTH_M_S * t_s, 0, 1), (NORTH_M_S, 0, 0))
            (listener,) = listeners
            asyncio.get_running_loop().call_at(t_s + latency_s, partial(listener, sample))

    readings = run_virtual(sensed(factory, setup, telemetry))
    errors_m = [abs(reading.range_m - NORTH_M_S * reading.t_s) for reading in readings]
    assert len(errors_m) > 50
    assert max(errors_m) < 0.01


def test_the_rays_of_a_world_are_built_once_with_its_sensors_before_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built: list[Scene] = []
    monkeypatch.setattr("wil_campaign.vehicles.sensors.world_views.SceneRayCaster", built.append)
    setup = setup_of(tmp_path, RANGE, SCAN, clock="wall")
    factory, vehicle = factory_of(setup, []), setup.vehicle("real")
    for sensor in vehicle.sensors:
        if sensor.name in {"range", "scan"}:
            factory.stream(vehicle, sensor)
            assert built == [setup.real_scene]
