"""Runs in which a vehicle of its own flies as the intruder of the world."""

from dataclasses import asdict

import pytest

from campaigns.expansion.expansion import Options, load_campaign
from orchestrator.analysis.reading.judged_motion import read_judged_motion
from orchestrator.campaign.reevaluation import judge_run_again
from orchestrator.model.document_writer import to_json, write_whole
from orchestrator.run.vehicles.pair import Pair
from orchestrator.run.vehicles.vehicle_backends import vehicle_seed
from orchestrator.state.run_state import RunState
from tests.orchestrator.conftest import ROOT, Fly
from tests.orchestrator.flights import all_landed, log_of

FLOWN = "actors={intruder: {link: embedded, autopilot: px4}}"
BLIND = "autonomy.with={object: person}"
COARSE = tuple(
    f"vehicles.{name}.sensors.camera.{key}={value}"
    for name in ("real", "twin")
    for key, value in (("width_px", 160), ("height_px", 120), ("rate_hz", 5))
)
SETS = (FLOWN, BLIND, *COARSE, "recipe.sensors.camera.rate_hz=5")


def test_what_does_not_evade_is_touched_by_the_vehicle_that_flies_at_it(fly_run: Fly) -> None:
    result, folder = fly_run("avoid", "fast", "sim", sets=SETS)
    assert (result.verdict, result.decided_by) == ("FAIL", "collision/twin"), result.reason
    (actor,) = result.actors
    assert actor.delay_s is not None
    assert actor.offset_m is not None
    assert 0.0 < actor.delay_s < 3.0
    assert 0.0 < actor.offset_m < 0.5
    assert {"intruder.tlog", "twin.tlog"} <= set(result.artifacts)
    # It flew by itself: not once exactly where the world file's motion has it.
    track = read_judged_motion(folder / "judged.msgpack").world_events.tracks["intruder"]
    assert track.travel(0.0, result.oracles[0].at_s or 60.0).length_m > 2.5
    phases = [one for one in log_of(folder) if one.get("vehicle") == "intruder"]
    assert phases[-1]["text"] == "intruder: down: it is disarmed" or any(
        one.get("kind") == "disarmed" for one in phases
    )
    # Judged again from the recording alone, it is touched at the same moment.
    plan = load_campaign(
        ROOT / "campaigns" / "avoid.yaml",
        Options(cases=("fast",), modes=("sim",), sets=(*SETS, "controls={}")),
    ).runs[0]
    write_whole(folder / "result.json", to_json(asdict(result)))
    again = judge_run_again(plan, folder).now
    touched = {one.name: one for one in result.oracles}["collision"]
    assert {one.name: one for one in again.oracles}["collision"] == touched
    assert again.verdict == "FAIL"


def test_equal_runs_with_an_actor_are_equal_to_the_byte(fly_run: Fly) -> None:
    flown = [fly_run("avoid", "fast", "sim", sets=SETS)[1] for _ in range(2)]
    one, other = ((folder / "judged.msgpack").read_bytes() for folder in flown)
    assert one == other


def test_in_reality_the_contact_with_the_vehicle_is_physical(fly_run: Fly) -> None:
    result, _ = fly_run("avoid", "fast", "real", sets=SETS)
    assert result.verdict == "FAIL"
    assert "touched intruder" in result.reason


def mute(pair: Pair, run_state: RunState) -> None:
    run_state.on_stage(
        lambda stage, _: pair.guard.start_outage("intruder", 60.0) if stage == "goal" else None
    )


@pytest.mark.parametrize("autonomy", [BLIND, "autonomy.with={for_s: 4}"])
def test_a_run_whose_actor_is_lost_never_passes(fly_run: Fly, autonomy: str) -> None:
    result, _ = fly_run("avoid", "fast", "sim", sets=(*SETS, autonomy), disturb=mute)
    assert result.verdict == "ERROR", result.reason
    assert "intruder" in result.reason


def test_an_actor_that_leaves_its_fence_lands_and_is_no_fault_of_the_subject(fly_run: Fly) -> None:
    tight = "{box: {north_m: [-0.81, 3], east_m: [-1, 1], up_m: [-0.5, 2.3]}}"
    sets = (*SETS, f"actors.intruder.geofence={tight}", "vehicles.twin.start.east_m=1.2")
    result, folder = fly_run("avoid", "fast", "sim", sets=sets)
    assert (result.verdict, result.decided_by) == ("ERROR", "guard.alone/intruder"), result.reason
    assert "intruder cannot stop before the fence's side" in result.reason
    assert [one.outcome for one in result.preflight if one.check == "home"] == ["ok", "ok"]
    kinds = [one.get("kind") for one in log_of(folder) if one.get("vehicle") == "intruder"]
    assert kinds.index("disarmed") > kinds.index("alone")
    assert all_landed(folder)


@pytest.mark.parametrize(
    ("limit", "said"),
    [
        ("max_delay_s=0.5", "behind its motion"),
        ("max_offset_m=0.01", "off its"),
        ("max_silence_s=0.001", "has sent no pose for 0.001 s (max_silence_s)"),
    ],
)
def test_an_actor_that_does_not_fly_its_motion_makes_the_run_invalid(
    fly_run: Fly, limit: str, said: str
) -> None:
    result, _ = fly_run("avoid", "fast", "sim", sets=(*SETS, f"actors.intruder.{limit}"))
    assert (result.verdict, result.decided_by) == ("INVALID", "actor/intruder"), result.reason
    assert said in result.reason


def test_no_two_vehicles_of_a_run_have_one_seed_and_each_fits_a_message() -> None:
    for seed in (0, 1, 2**63 - 1):
        seeds = [vehicle_seed(seed, name) for name in ("real", "twin", "intruder", "other")]
        assert len(set(seeds)) == 4
        assert all(0 <= one < 2**64 for one in seeds)
