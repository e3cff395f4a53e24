"""A campaign is resumed whose runs were flown by a plugin's engine, which fetches them."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import load_campaign
from wil_campaign.hooks import Engine
from wil_campaign.orchestrator.campaign.resuming import runs_to_fly
from wil_campaign.orchestrator.campaign.resuming.cluster_ledger import CampaignPlace, RunLedger
from wil_campaign.orchestrator.campaign.resuming.runs_to_fly import (
    ResumeRules,
    resume_campaign,
)
from wil_campaign.orchestrator.campaign.resuming.unchanged_campaign import ResumeError

FETCHED: list[Path] = []


def fetch(folder: Path, *, say: Callable[[str], None]) -> None:
    say("fetched")
    FETCHED.append(folder)


def resume(tmp_path: Path) -> list[str]:
    said: list[str] = []
    folder = tmp_path / "out"
    campaign = load_campaign(write_hover(tmp_path))
    resume_campaign(campaign, folder, ResumeRules(), say=said.append)
    return said


def test_the_engine_fetches_runs_that_were_flown_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "out").mkdir()
    farm = Engine("farm", "", "", "", "", fetch=f"{__name__}:fetch")
    monkeypatch.setattr(runs_to_fly, "plugin_additions", lambda _: {"farm": farm})
    assert resume(tmp_path) == []
    RunLedger(tmp_path / "out", "first", CampaignPlace("s3://b", "hover")).write(
        "ordered", "default/sim/1", "second", place="hover/default/sim/1"
    )
    assert resume(tmp_path)[0] == "fetched"
    assert [tmp_path / "out"] == FETCHED


def test_a_resumption_without_the_plugin_of_its_store_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its runs would be flown again, though they are finished."""
    (tmp_path / "out").mkdir()
    RunLedger(tmp_path / "out", "first", CampaignPlace("s3://b", "hover")).write(
        "ordered", "default/sim/1", "second", place="hover/default/sim/1"
    )
    why = "'ray' is of the plugin cluster, which is not installed: pip install it"
    monkeypatch.setattr(runs_to_fly, "plugin_additions", lambda _: {})
    monkeypatch.setattr(runs_to_fly, "absent_additions", lambda _: {"ray": why})
    with pytest.raises(ResumeError, match="has runs in a store: 'ray' is of the plugin cluster"):
        resume(tmp_path)
