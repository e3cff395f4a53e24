"""Whatever the twin does, the real flight is flown, judged by its own oracles, and landed."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.conftest import STEP
from tests.orchestrator.flights import all_landed, log_of, rows_of
from tests.orchestrator.run.flight.test_run import at_stage
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.run_results.result_parts import TwinResult
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.vehicles.setpoints import Setpoint, VelocitySetpoint
from wil_campaign.worlds.frames import scale

Fly = Callable[..., tuple[RunResult, Path]]
WIDE = ("geofence.box.north_m=[-8, 18]", "geofence.box.east_m=[-9, 9]")
TWIN_BOX = "geofence.twin={box: {north_m: [-0.8, 3.2], east_m: [-2.7, 2.7], up_m: [-0.5, 2.3]}}"


def flies_at(factor: float) -> Any:
    """Return a disturbance by which the twin flies its velocity setpoints so many times as fast."""

    def disturb(pair: VehiclePair, run_state: RunState) -> None:
        driver: Any = next(context.driver for context in pair.contexts if context.name == "twin")
        send = driver.send

        def scaled(setpoint: Setpoint) -> None:
            assert isinstance(setpoint, VelocitySetpoint)
            velocity_m_s = scale(setpoint.velocity_ned_m_s, factor)
            send(VelocitySetpoint(velocity_m_s, setpoint.yaw_rad, setpoint.yaw_rate_rad_s))

        driver.send = scaled

    return disturb


@pytest.mark.parametrize(
    ("coupling", "factor", "near_m"),
    [("follow", 0.8, 0.45), ("follow", 1.2, 0.45), ("free", 1.2, 3.0), ("shadow", 0.8, 3.0)],
)
def test_a_slower_or_faster_twin_leaves_the_real_flight_as_it_is(
    fly_run: Fly, coupling: str, factor: float, near_m: float
) -> None:
    sets = (f"vehicles.twin.coupling={coupling}", *WIDE)
    result, folder = fly_run(sets=sets, disturb=flies_at(factor))
    assert (result.verdict, result.reason) == ("PASS", "")
    assert result.twin is not None
    assert result.twin.coupling == coupling
    assert result.twin.dropped_out is None
    assert result.twin.distance_max_m is not None
    assert 0.0 < result.twin.distance_max_m < near_m
    assert result.sync.t0_skew_s == pytest.approx(0.0, abs=0.001)
    assert all_landed(folder)


def test_a_fault_of_a_placed_twins_camera_that_never_began_is_invalid(fly_run: Fly) -> None:
    fault = "faults={twin: {sensors: {camera: {stop: {on: goal, after_s: 300}}}}}"
    result, _ = fly_run(sets=(*STEP, "vehicles.twin.coupling=placed", fault))
    assert result.reason == (
        "an injected fault never began: "
        "the autonomy's sensor camera of twin stops 300 s after stage goal"
    )


def test_nothing_flies_a_placed_twin(fly_run: Fly) -> None:
    result, folder = fly_run(sets=("vehicles.twin.coupling=placed",))
    assert (result.verdict, result.reason) == ("PASS", "")
    assert {row["vehicle"] for row in rows_of(folder)} == {"real"}
    assert {oracle.vehicle for oracle in result.oracles} == {"real"}
    assert result.twin == TwinResult("placed", None, None, None, 1.0)
    assert result.mixing is not None
    shown = result.mixing.shown["gate"]
    assert shown.frames_shown == shown.frames_in_view > 10


def test_a_twin_beyond_the_bound_is_invalid_and_the_flight_goes_on(fly_run: Fly) -> None:
    sets = ("vehicles.twin.coupling=free", "sync.max_twin_distance_m=0.3", *WIDE)
    result, folder = fly_run(sets=sets, disturb=flies_at(0.5))
    assert result.verdict == "INVALID"
    assert result.reason.startswith("real and twin were 0.3")
    assert "sync.max_twin_distance_m is 0.3 m" in result.reason
    reached = next(
        oracle for oracle in result.oracles if (oracle.name, oracle.vehicle) == ("reached", "real")
    )
    assert reached.verdict == "PASS"
    assert not any(line.get("word") == "bring_down" for line in log_of(folder))
    assert all_landed(folder)


def test_a_twin_that_leaves_its_fence_lands_alone(fly_run: Fly) -> None:
    result, folder = fly_run(sets=("vehicles.twin.coupling=free", TWIN_BOX))
    assert (result.verdict, result.reason) == ("PASS", "")
    assert result.twin is not None
    assert result.twin.dropped_out is not None
    assert "twin" in result.twin.dropped_out.reason
    assert all_landed(folder)
    # The guard's landing of the twin, mid-flight for the other, is no collision of the twin's.
    left_s = result.twin.dropped_out.at_s
    of_twin = [oracle for oracle in result.oracles if oracle.vehicle == "twin"]
    assert not any("cage.floor" in one.detail for one in of_twin)
    assert all((one.at_s or 0.0) <= left_s for one in of_twin)
    assert all(" s after the goal" in one.detail for one in of_twin)
    twin_s = [float(row["t_s"]) for row in rows_of(folder) if row["vehicle"] == "twin"]
    assert max(twin_s) > left_s + 1.0
    seen = [one for one in result.evidence if one.vehicle == "twin" and not one.required]
    assert seen
    assert all(one.last_s is not None and one.last_s <= left_s for one in seen)
    assert all(one.verdict == "PASS" for one in seen)


def test_a_twin_that_dies_in_flight_is_reported(fly_run: Fly) -> None:
    def kill(pair: VehiclePair) -> None:
        twin: Any = pair.vehicles["twin"]
        twin.kill()

    result, _ = fly_run(disturb=at_stage("goal", 1.0, kill))
    assert (result.verdict, result.reason) == ("PASS", "")
    assert result.twin is not None
    assert result.twin.dropped_out is not None
    assert "nothing received from twin for 3 s" in result.twin.dropped_out.reason


def test_a_dead_twin_of_which_the_mixture_is_made_is_invalid(fly_run: Fly) -> None:
    def kill(pair: VehiclePair) -> None:
        twin: Any = pair.vehicles["twin"]
        twin.kill()

    sets = ("recipe.combine.0.transform=[]", "recipe.combine.0.max_skew_ms=10000")
    result, _ = fly_run(
        "avoid-ardupilot",
        "default",
        sets=sets,
        disturb=at_stage("goal", 1.0, kill),
        has_cameras=False,
    )
    assert result.verdict == "INVALID"
    assert "lidar" in result.reason
