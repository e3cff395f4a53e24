"""Before arming each autopilot is asked whether it will act on what it is told."""

import math
from typing import cast

import pytest

from campaigns.outside_setups import InjectionSetup
from campaigns.sensor_setups import RangefinderSetup
from campaigns.setup import VehicleSetup
from orchestrator.clock import run_virtual
from orchestrator.outside.honesty import NotHonouredError, prove, thing_of
from orchestrator.run.station import Station
from tests.orchestrator.outside.rigs import FakeDriver, FakeParameters, FakeStation
from vehicles.autopilots.base import AutopilotName
from worlds.frames import AT_ORIGIN, Pose

DOWN = Pose.of(0.0, 0.0, 0.0, pitch_rad=-math.pi / 2)
OBSTACLES = InjectionSetup(thing="obstacle_distance", to=("real", "twin"), sensor="lidar")
READY = {"PRX1_TYPE": 2.0, "AVOID_ENABLE": 3.0}


def vehicle(autopilot: AutopilotName = "ardupilot", mount: Pose = DOWN) -> VehicleSetup:
    below = RangefinderSetup(name="below", rate_hz=20.0, half_angle_rad=0.0, mount=mount)
    return VehicleSetup(
        name="real",
        link="embedded",
        autopilot=autopilot,
        profile="nominal",
        start=AT_ORIGIN,
        sensors=(below,),
    )


def proven(
    parameters: dict[str, float], injection: InjectionSetup, setup: VehicleSetup | None = None
) -> FakeParameters:
    station = FakeStation(driver=FakeDriver(parameters=FakeParameters(parameters)))
    vehicles = {"real": setup or vehicle()}
    run_virtual(prove([cast("Station", station)], vehicles, [injection]))
    return station.driver.parameters


def test_what_is_set_up_passes_and_only_what_matters_is_asked() -> None:
    assert proven(READY, OBSTACLES).asked == ["PRX1_TYPE", "PRX_TYPE", "AVOID_ENABLE"]


def test_what_would_be_ignored_is_refused_with_all_that_is_to_be_set() -> None:
    with pytest.raises(NotHonouredError) as refusal:
        proven({"PRX1_TYPE": 0.0, "AVOID_ENABLE": 1.0}, OBSTACLES)
    said = str(refusal.value)
    assert "real, obstacle_distance: PRX1_TYPE is 0" in said
    assert "set PRX1_TYPE to 2 and reboot the autopilot" in said
    assert "set AVOID_ENABLE to 3" in said


def test_a_parameter_that_does_not_exist_is_a_feature_that_is_not_there() -> None:
    vision = InjectionSetup(thing="vision_position_estimate", to=("real",))
    with pytest.raises(NotHonouredError, match="VISO_TYPE does not exist on this autopilot"):
        proven({}, vision)


def test_whom_nothing_is_told_is_asked_nothing() -> None:
    other = InjectionSetup(thing="obstacle_distance", to=("twin",), sensor="lidar")
    assert proven({}, other).asked == []


def test_a_rangefinder_is_height_or_proximity_by_where_it_looks() -> None:
    assert thing_of("distance_sensor", DOWN) == "distance_sensor"
    assert thing_of("distance_sensor", AT_ORIGIN) == "distance_sensor_sideways"
    sideways = InjectionSetup(thing="distance_sensor", to=("real",), sensor="below")
    assert proven(READY, sideways, vehicle(mount=AT_ORIGIN)).asked[0] == "PRX1_TYPE"
    with pytest.raises(NotHonouredError, match="RNGFND1_TYPE"):
        proven(READY, sideways)
