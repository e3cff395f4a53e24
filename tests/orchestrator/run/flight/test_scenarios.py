"""One short flight of each scenario of the paper beside the gate: it passes, and by what it saw."""

from collections.abc import Callable
from pathlib import Path

import pytest

from orchestrator.model.results import RunResult

Fly = Callable[..., tuple[RunResult, Path]]


@pytest.mark.timeout(300)
@pytest.mark.parametrize(("campaign", "case"), [("follow", "walk"), ("avoid", "slow")])
def test_the_scenario_passes_in_simulation(fly_run: Fly, campaign: str, case: str) -> None:
    result, _ = fly_run(campaign, case, "sim")
    assert (result.verdict, result.reason) == ("PASS", "")
