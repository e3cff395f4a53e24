"""Which runs teach how long a vehicle takes to leave the ground, and which would mislead."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.orchestrator.run_results.test_results import result
from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, load_campaign
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.orchestrator.campaign.liftoff_learning import LiftoffLearning
from wil_campaign.orchestrator.run_results.run_result import SyncResult
from wil_campaign.orchestrator.state.run_setup import RunOrder

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    return load_campaign(ROOT / "campaigns" / "gate.yaml", ExpansionOptions(cases=("large",)))


def known(campaign: Campaign, clock: Clock, mode: str, **measured_s: float) -> dict[str, float]:
    """Return what a run of the pair is told after one of a mode that measured this."""
    learning = LiftoffLearning(campaign, clock)
    flown = next(run for run in campaign.runs if run.mode == mode)
    learning.learn(flown, replace(result(), sync=SyncResult(liftoff_delays_s=measured_s)))
    pair = next(run for run in campaign.runs if run.mode == "wil")
    order = RunOrder(plan=pair, folder=Path("run"), clock=clock)
    return dict(learning.ready(order).liftoff_delays_s)


def test_a_run_of_the_pair_teaches_the_next_one(campaign: Campaign) -> None:
    measured_s = {"real": 3.2, "twin": 1.3}
    assert known(campaign, "wall", "wil", **measured_s) == measured_s


def test_a_vehicle_that_flies_alone_teaches_nothing(campaign: Campaign) -> None:
    """An ArduCopter alone took 3.13 s, its motors' 2 s among them; of a pair it takes 1.3 s."""
    assert known(campaign, "wall", "sim", twin=3.13) == {}


def test_no_run_in_virtual_time_depends_on_the_runs_before_it(campaign: Campaign) -> None:
    assert known(campaign, "virtual", "wil", real=3.2, twin=1.3) == {}
