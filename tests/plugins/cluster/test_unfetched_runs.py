"""Runs in a store, fetched when a campaign is resumed: one that is damaged stops no other."""

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import load_campaign
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.campaign.resuming.cluster_ledger import CampaignPlace, RunLedger
from wil_campaign.orchestrator.campaign.resuming.runs_without_result import lost_result
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.plugins.cluster.store import open_store
from wil_campaign.plugins.cluster.stored_runs import send_run
from wil_campaign.plugins.cluster.unfetched_runs import fetch_stored_runs

pytest.importorskip("fsspec", reason="needs the extra storage")


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1])


@pytest.mark.parametrize("damage", [truncate, Path.unlink])
def test_a_run_with_damaged_files_in_the_store_is_lost_and_others_are_fetched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damage: Callable[[Path], None]
) -> None:
    monkeypatch.setattr(time, "sleep", lambda _: None)  # between tries
    plans = load_campaign(write_hover(tmp_path)).runs
    store = open_store(f"file://{tmp_path}/store")
    folder = tmp_path / "out"
    folder.mkdir()
    ledger = RunLedger(folder, "first", CampaignPlace(store.url, "hover"))
    for plan in plans:
        flown = tmp_path / "node" / plan.name
        flown.mkdir(parents=True)
        (flown / "log.jsonl").write_text("{}\n")
        result = lost_result(plan, WorkerLost("as it is"), flown)
        (flown / "result.json").write_text(to_json(result))
        place = f"hover/{plan.name}"
        ledger.write("ordered", plan.name, "second", place=place)
        send_run(store, place, flown, lambda _: None)
    damage(tmp_path / "store" / "hover" / plans[0].name / "result.json")
    said: list[str] = []
    fetch_stored_runs(folder, say=said.append)
    fetched = [(folder / plan.name / "result.json").exists() for plan in plans]
    assert fetched == [False, True]
    (lost,) = [text for text in said if text.startswith(f"{plans[0].name}: it is lost: ")]
    assert f"{store.url}/hover/{plans[0].name}/result.json" in lost
