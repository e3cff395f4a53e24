"""Before arming each autopilot is asked whether it will act on what it is told."""

import typing
from dataclasses import replace
from typing import cast

import pytest

from tests.orchestrator.external.rigs import FakeDriver, FakeParameters, FakeStation
from wil_campaign.campaigns.setup.case_setup import VehicleSetup
from wil_campaign.campaigns.values.sensor_setups import OtherSensorSetup
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.plugins.injection.injection_setups import (
    Injected,
    InjectionSetup,
    injected_message_name,
)
from wil_campaign.plugins.injection.injections import (
    InjectionProof,
    UnsupportedInjectionError,
    prove_injection,
)
from wil_campaign.plugins.lidar.rangefinder import RangefinderOptions
from wil_campaign.vehicles.sensors.sensor_spec import MountPart
from wil_campaign.vehicles.setpoints import Setpoints
from wil_campaign.worlds.frames import AT_ORIGIN

DOWN = MountPart(pitch_deg=-90.0)
OBSTACLES = InjectionSetup(thing="obstacle_distance", to=("real", "twin"), sensor="lidar")
READY = {"PRX1_TYPE": 2.0, "AVOID_ENABLE": 3.0}


def vehicle(autopilot: str = "ardupilot", mount: MountPart = DOWN) -> VehicleSetup:
    options = RangefinderOptions(rate_hz=20.0, mount=mount)
    below = OtherSensorSetup(kind="rangefinder", name="below", options=options)
    return VehicleSetup(
        name="real",
        link="embedded",
        autopilot=autopilot,
        profile="nominal",
        start=AT_ORIGIN,
        system_id=1,
        sensors=(below,),
    )


def proven(
    parameters: dict[str, float], injection: InjectionSetup, setup: VehicleSetup | None = None
) -> FakeParameters:
    context = FakeStation(driver=FakeDriver(parameters=FakeParameters(parameters)))
    vehicles = {"real": setup or vehicle()}
    run_virtual(
        prove_injection([cast("VehicleContext", context)], vehicles, [injection], unbooted={})
    )
    return context.driver.parameters


def test_a_vehicle_that_is_set_up_passes_and_is_asked_relevant_parameters_alone() -> None:
    assert proven(READY, OBSTACLES).asked == ["PRX1_TYPE", "PRX_TYPE", "AVOID_ENABLE"]


def test_an_injection_that_would_be_ignored_is_refused_with_every_remedy() -> None:
    with pytest.raises(UnsupportedInjectionError) as refusal:
        proven({"PRX1_TYPE": 0.0, "AVOID_ENABLE": 1.0}, OBSTACLES)
    said = str(refusal.value)
    assert "real, obstacle_distance: PRX1_TYPE is 0" in said
    assert "set PRX1_TYPE to 2 and reboot the autopilot" in said
    assert "set AVOID_ENABLE to 3" in said


def test_a_parameter_that_does_not_exist_is_a_feature_that_is_not_there() -> None:
    vision = InjectionSetup(thing="vision_position_estimate", to=("real",))
    with pytest.raises(
        UnsupportedInjectionError, match="VISO_TYPE does not exist on this autopilot"
    ):
        proven({}, vision)


def test_a_vehicle_without_injection_is_asked_nothing() -> None:
    other = InjectionSetup(thing="obstacle_distance", to=("twin",), sensor="lidar")
    assert proven({}, other).asked == []


def test_a_range_sensor_that_only_stands_by_need_not_be_acted_on() -> None:
    assert proven({}, replace(OBSTACLES, only_stands_by=True)).asked == []


def test_a_rangefinder_is_height_or_proximity_by_where_it_looks() -> None:
    assert injected_message_name("distance_sensor", DOWN.pose()) == "distance_sensor"
    assert injected_message_name("distance_sensor", AT_ORIGIN) == "distance_sensor_sideways"
    sideways = InjectionSetup(thing="distance_sensor", to=("real",), sensor="below")
    assert proven(READY, sideways, vehicle(mount=MountPart())).asked[0] == "PRX1_TYPE"
    with pytest.raises(UnsupportedInjectionError, match="RNGFND1_TYPE"):
        proven(READY, sideways)


INJECTED: tuple[Injected, ...] = typing.get_args(Injected)
NEVER = {("px4", "obstacle_distance"), ("px4", "landing_target")}
"""What OFFBOARD flies into, and PX4's LAND lands beside."""
WHAT_TO_SET = {
    ("ardupilot", "obstacle_distance"): {"PRX1_TYPE": 2, "AVOID_ENABLE": 2},
    ("ardupilot", "distance_sensor"): {"RNGFND1_TYPE": 10, "RNGFND1_ORIENT": 25},
    ("ardupilot", "adsb_vehicle"): {"ADSB_TYPE": 1, "AVD_ENABLE": 1, "AVD_F_ACTION": 3},
    ("ardupilot", "landing_target"): {"PLND_ENABLED": 1, "PLND_TYPE": 1},
    ("ardupilot", "vision_position_estimate"): {"VISO_TYPE": 1, "EK3_SRC1_POSXY": 6},
    ("ardupilot", "odometry"): {"VISO_TYPE": 1, "EK3_SRC1_POSXY": 6},
    ("px4", "distance_sensor"): {"EKF2_RNG_CTRL": 1},
    ("px4", "adsb_vehicle"): {"NAV_TRAFF_AVOID": 4},
    ("px4", "vision_position_estimate"): {"EKF2_EV_CTRL": 1},
    ("px4", "odometry"): {"EKF2_EV_CTRL": 1},
}


@pytest.mark.parametrize("thing", INJECTED)
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_each_thing_on_each_autopilot_is_refused_until_the_remedy_is_set(
    autopilot: str, thing: Injected
) -> None:
    setup = vehicle(autopilot)
    injection = InjectionSetup(thing=thing, to=("real",), sensor="below")
    if (autopilot, thing) in NEVER:
        with pytest.raises(
            UnsupportedInjectionError, match=r"in mode (OFFBOARD|LAND): .*; fly in "
        ):
            proven({"CP_DIST": 2.0, "MPC_POS_MODE": 4.0, "RTL_PLD_MD": 1.0}, injection, setup)
        return
    needed = WHAT_TO_SET[autopilot, thing]
    with pytest.raises(UnsupportedInjectionError) as refusal:
        proven(dict.fromkeys(needed, 0.0), injection, setup)
    for name, value in needed.items():
        assert f"real, {thing}: {name} is 0" in str(refusal.value) or f"; {name}" in str(refusal)
        assert f"set {name} to {value}" in str(refusal.value)
    proven({name: float(value) for name, value in needed.items()}, injection, setup)


def test_a_parameter_that_was_just_set_and_needs_a_boot_does_not_count() -> None:
    context = FakeStation(driver=FakeDriver(parameters=FakeParameters(dict(READY))))
    just_set = {"real": frozenset({"PRX1_TYPE", "AVOID_ENABLE"})}
    proving = prove_injection(
        [cast("VehicleContext", context)], {"real": vehicle()}, [OBSTACLES], unbooted=just_set
    )
    with pytest.raises(UnsupportedInjectionError) as refusal:
        run_virtual(proving)
    assert "PRX1_TYPE was set to 2 since the autopilot booted" in str(refusal.value)
    assert "reboot it" in str(refusal.value)
    assert "AVOID_ENABLE" not in str(refusal.value)


@pytest.mark.parametrize(
    ("mode", "steered_by", "said"),
    [
        ("GUIDED", None, ""),
        ("GUIDED", "velocity", ""),
        ("GUIDED", "position", "position setpoints in GUIDED are not adjusted"),
        ("GUIDED", "attitude", "attitude setpoints are not adjusted"),
        ("BRAKE", "velocity", "in mode BRAKE: simple avoidance is not used"),
    ],
)
def test_mode_and_setpoints_in_flight_are_compared_with_the_proof(
    mode: str, steered_by: Setpoints | None, said: str
) -> None:
    context = FakeStation(steered_by=steered_by)
    context.driver.state.mode_name = mode
    proof = InjectionProof(cast("VehicleContext", context), "ardupilot", "obstacle_distance", READY)
    found = proof.text_of(proof.broken())
    assert said in found
    assert bool(found) == bool(said)


def test_a_landing_target_says_nothing_about_the_flight_before_the_landing() -> None:
    proof = InjectionProof(cast("VehicleContext", FakeStation()), "ardupilot", "landing_target", {})
    assert proof.broken() == ()
