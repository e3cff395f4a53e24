"""One short flight of each scenario of the paper beside the gate: it passes, and by what it saw."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.orchestrator.conftest import SMALL_CAMERAS
from wil_campaign.orchestrator.run_results.run_result import RunResult

Fly = Callable[..., tuple[RunResult, Path]]


@pytest.mark.parametrize(("campaign", "case"), [("follow", "walk"), ("avoid", "slow")])
def test_the_scenario_passes_in_simulation(fly_run: Fly, campaign: str, case: str) -> None:
    result, _ = fly_run(campaign, case, "sim", cameras=SMALL_CAMERAS)
    assert (result.verdict, result.reason) == ("PASS", "")


def test_the_twin_follows_an_evasion_within_its_fence(fly_run: Fly) -> None:
    result, _ = fly_run("avoid", "slow", "wil", cameras=SMALL_CAMERAS)
    assert (result.verdict, result.reason) == ("PASS", "")
    assert result.twin is not None
    assert result.twin.dropped_out is None
