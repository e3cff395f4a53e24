"""Each check of the preflight sees the fault it is for, in an embedded vehicle that has it."""

import asyncio
import itertools
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.orchestrator.conftest import BRIEF, Fly
from tests.orchestrator.flights import log_of
from tests.vehicles.embedded.charge import set_remaining
from wil_campaign.orchestrator.run.vehicles import vehicle_backends
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.run.vehicles.preflight_checks import PreflightChecks
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import HISTORY_S, VehicleContext
from wil_campaign.plugins.ardupilot.copter import copter_telemetry
from wil_campaign.plugins.ardupilot.copter.copter_core import CopterCore
from wil_campaign.safety.preflight import PreflightItem
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.embedded.autopilot.px4 import px4_telemetry
from wil_campaign.vehicles.embedded.autopilot.px4.px4_core import Px4Core
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.readings import PoseReading
from wil_campaign.worlds.frames import Pose, quat_multiply

ARDUPILOT = "vehicles.twin.autopilot=ardupilot"


def once_ready(name: str, break_it: Callable[[EmbeddedVehicle], None]) -> Any:
    """Return a disturbance that breaks something in a vehicle that said it is ready to arm."""

    def disturb(pair: VehiclePair, _: RunState) -> None:
        (context,) = [one for one in pair.contexts if one.name == name]
        vehicle, ready = pair.vehicles[name], context.driver.ready
        assert isinstance(vehicle, EmbeddedVehicle)

        times = itertools.count(1)

        async def ready_and_broken(timeout_s: float) -> None:
            await ready(timeout_s)
            # It is asked again when all has been put aboard; the preflight follows that.
            if next(times) == 2:
                break_it(vehicle)
                await asyncio.sleep(2.0)

        context.driver.ready = ready_and_broken  # type: ignore[method-assign]  # to break it then

    return disturb


def refusals(flown: tuple[RunResult, Path]) -> list[str]:
    result, folder = flown
    assert result.verdict == "ERROR"
    assert result.reason.startswith("preflight: ")
    assert not any(line.get("kind") == "armed" for line in log_of(folder))
    refused = [item for item in result.preflight if item.outcome == "refused"]
    return [str(item) for item in refused]


def gps_of(fix: int, satellites: int, hdop_cm: int) -> Any:
    def build(s: Any) -> Any:
        return mavlink.MAVLink_gps_raw_int_message(
            s.boot_us, fix, 0, 0, 0, hdop_cm, 200, 0, 0, satellites
        )

    return build


def test_a_battery_that_is_low(fly_run: Fly) -> None:
    disturb = once_ready("twin", lambda vehicle: set_remaining(vehicle._body.battery, 0.2))
    (said,) = refusals(fly_run(mode="sim", disturb=disturb))
    assert said == "twin battery: its charge is 0.2, and at least 0.3 is required"


@pytest.mark.parametrize("sets", [(), (ARDUPILOT,)], ids=["px4", "ardupilot"])
def test_an_estimator_that_gives_up(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch, sets: tuple[str, ...]
) -> None:
    def lost(_: EmbeddedVehicle) -> None:
        sound = px4_telemetry.estimator_status

        def px4(s: Any, **more: Any) -> Any:
            message = sound(s, **more)
            message.flags = 1
            return message

        def ardupilot(_: Any) -> Any:
            return mavlink.MAVLink_ekf_status_report_message(1, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0)

        monkeypatch.setattr(px4_telemetry, "estimator_status", px4)
        number = mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT
        monkeypatch.setitem(CopterCore.builders, number, ardupilot)

    (said,) = refusals(fly_run(mode="sim", sets=sets, disturb=once_ready("twin", lost)))
    assert said.startswith("twin estimator: ")
    assert "position" in said


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize(
    ("built", "said"),
    [
        (gps_of(0, 255, 65535), "it has no GPS receiver; say gps: false of a vehicle"),
        (gps_of(2, 9, 90), "it has no 3D fix"),
        (gps_of(3, 5, 90), "the number of visible satellites is 5, and at least 6 is required"),
        (gps_of(3, 255, 90), "the number of visible satellites is not known"),
        (gps_of(4, 12, 310), "HDOP is 3.1, and at most 2.5 is allowed"),
        (lambda _: None, "it reports nothing of its GPS receiver"),
    ],
    ids=["no receiver", "no height", "few", "unknown", "diluted", "silent"],
)
def test_a_gps_that_is_not_fit_to_fly_by(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch, autopilot: str, built: Any, said: str
) -> None:
    for core in (Px4Core, CopterCore):
        monkeypatch.setitem(core.builders, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, built)
    (refused,) = refusals(fly_run(mode="sim", sets=(f"vehicles.twin.autopilot={autopilot}",)))
    assert refused.startswith(f"twin gps: {said}")


def test_a_vehicle_without_gps_may_say_so(fly_run: Fly, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(Px4Core.builders, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, gps_of(0, 255, 65535))
    result, _ = fly_run(mode="sim", sets=(*BRIEF, "preflight.gps=null"))
    assert result.verdict == "PASS"
    assert not [item for item in result.preflight if item.check == "gps"]


def imprecise_sim_state(s: Any) -> Any:
    """Return the SIM_STATE of an ArduPilot that knows neither lat_int nor lon_int."""
    message = copter_telemetry.sim_state(s)
    if message is not None:
        message.lat_int = message.lon_int = 0
    return message


def slow(vehicle: EmbeddedVehicle) -> None:
    vehicle._mocap._noise = vehicle._mocap._noise.model_copy(update={"rate_hz": 4})


def silent(vehicle: EmbeddedVehicle) -> None:
    vehicle._mocap._callbacks.clear()


def turned_over(vehicle: EmbeddedVehicle) -> None:
    """As one whose forward, left, up axes are sent as forward, right, down."""
    callbacks = vehicle._mocap._callbacks
    deliver = tuple(callbacks)

    def take(reading: PoseReading) -> None:
        q_wxyz = quat_multiply(reading.pose.q_wxyz, (0.0, 1.0, 0.0, 0.0))
        for callback in deliver:
            callback(replace(reading, pose=replace(reading.pose, q_wxyz=q_wxyz)))

    callbacks[:] = [take]


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (turned_over, ["real mocap: the angle of its vertical axis by motion capture from that "]),
        (slow, ["real mocap: the rate of its motion capture poses is 4 Hz, and at least 10 Hz"]),
        (
            silent,
            [
                "real position: its distance from its start pose by mocap is not known",
                "real mocap: the age of its motion capture pose is ",
                "real home: its position is not known",
                (
                    "pair: the difference of the offsets of real and twin from their "
                    "start poses is not known"
                ),
            ],
        ),
    ],
)
def test_motion_capture_that_is_slow_or_silent_or_turned_over(
    fly_run: Fly, fault: Callable[[EmbeddedVehicle], None], said: list[str]
) -> None:
    refused = refusals(fly_run(disturb=once_ready("real", fault)))
    assert [text[: len(start)] for text, start in zip(refused, said, strict=True)] == said


def test_a_vehicle_that_stands_elsewhere(fly_run: Fly, monkeypatch: pytest.MonkeyPatch) -> None:
    def config(**values: Any) -> EmbeddedConfig:
        made = EmbeddedConfig(**values)
        aside = Pose((-1.3, 0.0, 0.0))
        return replace(made, start=aside) if made.source == "real" else made

    monkeypatch.setattr(vehicle_backends, "EmbeddedConfig", config)
    refused = refusals(fly_run())
    assert [text.split(":")[0] for text in refused] == ["real position", "real home", "pair"]
    assert "1.3 m, and at most 0.5 m is allowed" in refused[0]
    assert "m outside of the fence's" in refused[1]


RALLY, MISSION = mavlink.MAV_MISSION_TYPE_RALLY, mavlink.MAV_MISSION_TYPE_MISSION
RALLY_POINT, LAND = mavlink.MAV_CMD_NAV_RALLY_POINT, mavlink.MAV_CMD_NAV_LAND
WAYPOINT, DO_LAND_START = mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_DO_LAND_START
PX4_RETURNS, SET = "vehicles.twin.params={NAV_DLL_ACT: 2}", "preflight.failsafe=set"
OUTSIDE = "its rally points, 36 m outside of the fence; clear its rally points"


def stores(kind: int, *places: tuple[int, float, float]) -> Callable[[EmbeddedVehicle], None]:
    """Return what stores a list in a vehicle: commands, metres north of home, and height."""

    def store(vehicle: EmbeddedVehicle) -> None:
        autopilot = vehicle._autopilot
        home = autopilot._home_item()
        items = [
            home._replace(command=command, frame=3, x=home.x + round(north_m / 0.0111319), z=up_m)
            for command, north_m, up_m in places
        ]
        first = [home] if kind == MISSION and autopilot.firmware.first_mission_item else []
        autopilot._item_lists._lists[kind] = (*first, *items)

    return store


@pytest.mark.parametrize(
    ("sets", "stored", "said"),
    [
        ((PX4_RETURNS,), stores(RALLY, (RALLY_POINT, 1, 0), (RALLY_POINT, 40.6, 0)), OUTSIDE),
        ((PX4_RETURNS,), stores(RALLY, (RALLY_POINT, 1, 9)), "1 of its rally points, 7 m outside"),
        ((PX4_RETURNS,), stores(RALLY, (RALLY_POINT, 1, 0)), ""),
        ((), stores(RALLY, (RALLY_POINT, 40.6, 0)), ""),
        (
            ("vehicles.twin.params={COM_OBL_RC_ACT: 3, RTL_TYPE: 2}",),
            stores(MISSION, (WAYPOINT, 40, 1), (LAND, 30, 0)),
            "item 1 of its stored mission",
        ),
        (
            ("vehicles.twin.params={NAV_DLL_ACT: 2, RTL_TYPE: 3}",),
            stores(MISSION, (WAYPOINT, 40, 1), (DO_LAND_START, 1, 0), (LAND, 20, 0)),
            "item 3 of its stored mission",
        ),
        (
            (ARDUPILOT, "vehicles.twin.params={FS_GCS_ENABLE: 1}"),
            stores(RALLY, (RALLY_POINT, 40.6, 0)),
            OUTSIDE,
        ),
        (
            (ARDUPILOT, "vehicles.twin.params={FS_GCS_ENABLE: 6}"),
            stores(MISSION, (WAYPOINT, 1, 1), (LAND, 30, 0)),
            "item 2 of its stored mission",
        ),
    ],
)
def test_a_failsafe_that_returns_to_a_place_outside_of_the_fence(
    fly_run: Fly, sets: tuple[str, ...], stored: Callable[[EmbeddedVehicle], None], said: str
) -> None:
    disturb = once_ready("twin", stored)
    flown = fly_run(mode="sim", sets=(*sets, SET, *BRIEF), disturb=disturb)
    if not said:
        assert [item for item in flown[0].preflight if item.outcome == "refused"] == []
        return
    (refused,) = refusals(flown)
    assert refused.startswith("twin failsafe: it would return to item ")
    assert said in refused


def test_a_clock_that_is_not_known_well_enough(fly_run: Fly) -> None:
    sets = ("links.twin={latency_ms: 300}", "sync.ready_timeout_s=90")
    (said,) = refusals(fly_run(mode="sim", sets=sets))
    assert said.startswith("twin clock: the uncertainty of its clock is 0.3")


def test_an_override_is_reported_at_the_end(fly_run: Fly) -> None:
    sets = (*BRIEF, "preflight.min_battery=1", "preflight.override={battery: J. Doe}")
    disturb = once_ready("twin", lambda vehicle: set_remaining(vehicle._body.battery, 0.5))
    result, _ = fly_run(mode="sim", sets=sets, disturb=disturb)
    assert result.verdict == "PASS"
    (item,) = [item for item in result.preflight if item.outcome == "overridden"]
    assert (item.check, item.by, item.actual) == ("battery", "J. Doe", 0.5)


@pytest.mark.parametrize(
    ("autopilot", "built", "said"),
    [
        ("px4", lambda _: None, "its simulator sends no HIL_STATE_QUATERNION: is it a simul"),
        ("ardupilot", lambda _: None, "its simulator sends no SIM_STATE: is it a simulation?"),
        ("ardupilot", imprecise_sim_state, "SIM_STATE has no lat_int and lon_int"),
    ],
)
def test_a_simulator_that_does_not_say_where_its_vehicle_is(
    fly_run: Fly,
    monkeypatch: pytest.MonkeyPatch,
    autopilot: str,
    built: Any,
    said: str,
) -> None:
    core = Px4Core if autopilot == "px4" else CopterCore
    monkeypatch.setitem(core.builders, autopilot_named(autopilot).truth_message_id, built)
    sets = (f"vehicles.twin.autopilot={autopilot}", "vehicles.twin.pose_source=simulator")
    first, *others = refusals(fly_run(mode="sim", sets=sets))
    assert first.startswith("twin position: its distance from its start pose by simulator is not")
    assert others[0].startswith(f"twin ground_truth: {said}")
    assert "pose_source: mavlink judges by its estimate" in others[0]


def test_a_ground_truth_that_was_just_anchored_is_no_missing_one(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On an attached PX4 whose parameters were set already the checks came 20 ms after it."""
    check_source = PreflightChecks._source

    async def just_anchored(
        self: PreflightChecks, context: VehicleContext
    ) -> Iterable[PreflightItem]:
        first = context.poses.latest().pose
        assert first is not None
        context.poses = PoseHistory(HISTORY_S)
        context.poses.add(asyncio.get_running_loop().time(), first)
        return await check_source(self, context)

    monkeypatch.setattr(PreflightChecks, "_source", just_anchored)
    result, _ = fly_run(mode="sim", sets=(*BRIEF, "vehicles.twin.pose_source=simulator"))
    assert result.verdict == "PASS", result.reason
    (item,) = [item for item in result.preflight if item.check == "ground_truth"]
    assert item.actual == pytest.approx(50.0, rel=0.1)
