"""The oracles of a run: with the world, and the body, by which they judge."""

from pathlib import Path

import pytest

from tests.orchestrator.wall import write_wall
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.run.judging.run_oracles import build_judge
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.safety.model.samples import PoseSample, StageSample
from wil_campaign.worlds.frames import Pose

BODY = "vehicles.twin.body={width_m: 0.3, height_m: 0.2}"


@pytest.mark.parametrize(
    ("min_m", "found"),
    [(1.9, ("PASS", None)), (2.2, ("FAIL", 2.15)), (3.0, ("FAIL", 2.15)), (2.1, ("PASS", None))],
)
def test_a_clearance_is_judged_as_far_as_it_is_to_be_kept(
    tmp_path: Path, min_m: float, found: tuple[str, float | None]
) -> None:
    """The wall's face stands at 2.95 m north, 2.15 m ahead of the body."""
    sets = (f"oracles={{clearance: {{min_m: {min_m}}}, landed: {{}}}}", BODY)
    plan = load_campaign(write_wall(tmp_path), ExpansionOptions(sets=sets)).runs[0]
    judge = build_judge(RunSetup.of(RunOrder(plan=plan, folder=tmp_path, clock="virtual")), {})
    judge.stage(StageSample(0.0, "takeoff"))
    judge.stage(StageSample(0.5, "at_height"))
    judge.pose(PoseSample(1.0, "twin", Pose((0.65, 0.0, -1.2)), (0.0, 0.0, 0.0)))
    (result,) = [one for one in judge.results(2.0) if one.name == "clearance"]
    assert result.verdict == found[0]
    assert result.actual == pytest.approx(found[1], abs=1e-3)


@pytest.mark.parametrize(("width_m", "touched"), [(0.3, False), (1.0, True)])
def test_contacts_are_judged_by_the_body_that_the_campaign_gives(
    tmp_path: Path, width_m: float, touched: bool
) -> None:
    """The wall's face stands 0.35 m ahead: within half of 1 m, and beyond half of 0.3 m."""
    sets = (f"vehicles.twin.body={{width_m: {width_m}, height_m: 0.2}}",)
    plan = load_campaign(write_wall(tmp_path), ExpansionOptions(sets=sets)).runs[0]
    judge = build_judge(RunSetup.of(RunOrder(plan=plan, folder=tmp_path, clock="virtual")), {})
    judge.stage(StageSample(0.0, "takeoff"))
    judge.stage(StageSample(0.5, "at_height"))
    flags = judge.pose(PoseSample(1.0, "twin", Pose((2.6, 0.0, -1.2)), (0.0, 0.0, 0.0)))
    assert [flag.text for flag in flags] == (["twin touched wall.box"] if touched else [])
