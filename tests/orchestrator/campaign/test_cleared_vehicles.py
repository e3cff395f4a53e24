"""Which vehicles were cleared to fly goes with each run."""

from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import load_campaign
from wil_campaign.orchestrator.campaign.campaign_runner import fly_campaign
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.workers.worker_pool import WorkerPool
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.orchestrator.state.run_setup import RunOrder


def test_a_run_knows_which_vehicles_were_cleared(
    tmp_path: Path, short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))
    ordered: list[RunOrder] = []

    async def fly(_: object, orders: Iterable[RunOrder]) -> None:
        ordered.extend(orders)

    monkeypatch.setattr(WorkerPool, "fly", fly)
    cleared = ClearedCampaign("virtual", 1, uids={"real at udpin://:14540": "4d"})
    campaign = load_campaign(write_hover(tmp_path))
    fly_campaign(campaign, FlightOptions(out=tmp_path / "out"), cleared, SilentDisplay())
    assert [order.uids for order in ordered] == [cleared.uids] * 2
