"""The ground in the open, how a vehicle meets it, and what never moved, in whole flights."""

from pathlib import Path

import pytest

from tests.faults.missions import LEGS
from tests.orchestrator.campaign.resuming.test_runs_to_fly import NoCommands
from tests.orchestrator.conftest import vehicles_on
from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.run.flight.run import fly_one_run
from wil_campaign.orchestrator.run_results.caveats import campaign_caveats
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup

SCRAPE = "[[0.5, 0, -1, 1.2], [1, 0, -0.3, 1.65], [0, 0, 1, 1.5]]"
DRIVEN = "[[0, 0, -1.8, 1.2], [0, 0, 1, 1.5]]"
STILL = "[[0, 0, 0, 1]]"
DRONE = (
    "world.objects={drone: {shape: quadrotor, pose: {north_m: 9, up_m: 1}, motion: "
    "{start: {on: goal, delay_s: %s}, "
    "waypoints: [{north_m: 8, east_m: 0, up_m: 1, speed_m_s: 1}]}}}"
)


def flown(folder: Path, legs: str, *sets: str) -> RunResult:
    """Return the result of a flight in a world without a room."""
    path = write_hover(folder)
    (folder / "still.py").write_text(LEGS.replace("class Legs", "class Still"))
    autonomy = f"autonomy={{use: still.py:Still, with: {{legs: {legs}}}}}"
    plan = load_campaign(path, ExpansionOptions(sets=(autonomy, *sets))).runs[0]
    order = RunOrder(plan=plan, folder=folder / "run", clock="virtual")
    order.folder.mkdir()
    with vehicles_on():
        return fly_one_run(RunSetup.of(order), lambda _: None, NoCommands())


@pytest.mark.parametrize("legs", [SCRAPE, DRIVEN])
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_vehicle_that_touches_the_ground_in_flight_fails(
    tmp_path: Path, legs: str, autopilot: str
) -> None:
    """Both climb again, and land as they should."""
    result = flown(tmp_path, legs, f"vehicles.twin.autopilot={autopilot}")
    assert (result.verdict, result.decided_by) == ("FAIL", "collision_always/twin")
    assert result.reason.startswith("twin touched the ground")


def test_nothing_is_touched_where_the_world_has_its_ground_lower(tmp_path: Path) -> None:
    """The vehicle starts on a table of a metre: what it flies over is as far below."""
    low = "[[0, 0, -1, 1.1], [0, 0, 1, 1.5]]"
    sets = ("vehicles.twin.start={up_m: 1}", "goal.altitude_m=2.2", "world.ground_up_m=0")
    assert flown(tmp_path, low, *sets).verdict == "PASS"


def test_a_hard_landing_fails_by_the_profile_or_by_the_campaign(tmp_path: Path) -> None:
    fast = "vehicles.twin.params={MPC_LAND_SPEED: 1.8}"
    hard = flown(tmp_path, STILL, fast)
    assert (hard.verdict, hard.decided_by) == ("FAIL", "touchdown_always/twin")
    (result,) = [oracle for oracle in hard.oracles if oracle.name == "touchdown_always"]
    assert result.limit == 1.0
    assert result.actual is not None
    assert 1.3 < result.actual < 1.9


@pytest.mark.parametrize(("delay_s", "said"), [("30", True), ("0.2", False)])
def test_an_object_that_never_moved_is_a_caveat(tmp_path: Path, delay_s: str, said: bool) -> None:
    result = flown(tmp_path, STILL, DRONE % delay_s)
    assert result.verdict == "PASS"
    assert result.unmoved == (("drone",) if said else ())
    line = "never moved while the goal was flown: drone (default sim, 1 run)"
    assert (line in campaign_caveats([result])) is said


def test_an_autonomy_that_gives_up_before_the_encounter_fails(tmp_path: Path) -> None:
    asked = "oracles.encounter={object: drone, within_m: 2, for_s: 1}"
    result = flown(tmp_path, STILL, DRONE % "0.2", asked)
    assert (result.verdict, result.decided_by) == ("FAIL", "encounter/twin")
    assert "drone was never nearer than 7" in result.reason


def test_a_time_out_is_named_with_what_was_not_reached_by_then(tmp_path: Path) -> None:
    sets = (
        "goal.position={north_m: 5, east_m: 0, up_m: 1.2}",
        "oracles={reached_position: {tolerance_m: 0.5}, time_limit: {limit_s: 1}}",
    )
    result = flown(tmp_path, "[[0, 0, 0, 3]]", *sets)
    assert result.decided_by == "reached_position/twin"
    assert "against 0.5 m; twin was not done 1 s after its goal" in result.reason
