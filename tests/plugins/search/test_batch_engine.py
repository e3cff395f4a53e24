"""What an engine of a search makes of a batch that was flown as a campaign."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.plugins.search.searches import MadeUpEngine, write_search
from wil_campaign.campaigns.expansion.expansion import load_campaign
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.orchestrator.run_results.run_result import Stop
from wil_campaign.plugins.search import engine


@pytest.mark.parametrize(
    ("ended", "flown_now", "stopped"),
    [
        (None, False, None),  # a real vehicle's flight of an earlier start: it is not flown again
        (None, True, "command"),
        ("command", False, "command"),
        ("command", True, "command"),
    ],
)
def test_a_flight_that_was_aborted_before_stops_no_search(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    ended: Stop | None,
    flown_now: bool,
    stopped: Stop | None,
) -> None:
    """Each --resume of a search on hardware asked for consent, flew nothing, and ended with 4."""
    campaign = load_campaign(write_search(tmp_path))
    runs = MadeUpEngine().fly(campaign, tmp_path).runs
    first, *others = runs
    runs = {**runs, first: replace(runs[first], verdict="ABORTED")}
    outcome = SimpleNamespace(
        summary=SimpleNamespace(runs=tuple(runs.values()), stopped=ended, broken=False),
        exit_code=4,
        announced=frozenset([first, *others] if flown_now else others),
    )
    monkeypatch.setattr(engine, "fly_campaign", lambda *_, **__: outcome)
    batch = engine.BatchEngine(cleared=ClearedCampaign("virtual", 1), watcher=SilentDisplay())
    result = batch.fly(campaign, tmp_path / "batch")
    assert result.stopped == stopped
    assert result.runs[first].verdict == "ABORTED"
