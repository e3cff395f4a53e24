"""The status of campaigns for a console: verdicts and reasons, also of a program that died."""

import json
from pathlib import Path
from typing import Any

import pytest

from wil_campaign.orchestrator.operator.campaign_records import CampaignRecord, OperatorPlace
from wil_campaign.plugins.console import campaign_poller
from wil_campaign.plugins.console.campaign_poller import CampaignPoller
from wil_campaign.plugins.console.flight_scope import FlightScope

REASON = "real: arming was refused"


def write(path: Path, document: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document))


def test_verdicts_have_their_reasons_and_outlive_a_program_that_died(
    tmp_path: Path, short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))
    finished = {"small/wil/5": "ERROR", "small/wil/6": "PASS"}

    def answer(place: OperatorPlace) -> dict[str, Any]:
        return {"name": place.name, "folder": str(place.folder), "finished": finished}

    monkeypatch.setattr(campaign_poller, "_status", answer)
    write(tmp_path / "small" / "wil" / "5" / "result.json", {"reason": REASON})
    with CampaignPoller(FlightScope()) as poller:
        with CampaignRecord(name="gate", folder=tmp_path):
            (flying,) = poller.poll()["campaigns"]
        # What is not written yet is read when it is.
        assert (flying["is_over"], flying["reasons"]) == (False, {"small/wil/5": REASON})
        (ended,) = poller.poll()["campaigns"]
        assert (ended["is_over"], ended["finished"]) == (True, finished)
        assert ended["reasons"] == {"small/wil/5": REASON}
        run = {"case": "small", "mode": "wil", "rep": 5, "verdict": "ERROR", "reason": REASON}
        write(tmp_path / "summary.json", {"runs": [run], "accepted": False})
        (told,) = poller.poll()["campaigns"]
        assert (told["accepted"], told["finished"]) == (False, {"small/wil/5": "ERROR"})
        assert told["controls"] == {}
        # It is resumed, and the run is flown again.
        write(tmp_path / "small" / "wil" / "5" / "result.json", {"reason": ""})
        finished["small/wil/5"] = "PASS"
        with CampaignRecord(name="gate", folder=tmp_path):
            (flying,) = poller.poll()["campaigns"]
        assert (flying["finished"]["small/wil/5"], flying["reasons"]) == (
            "PASS",
            {"small/wil/5": ""},
        )
        assert "accepted" not in flying


def test_controls_are_listed_with_whether_they_ended_as_they_must(
    tmp_path: Path, short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))
    finished = {"large/sim/1": "PASS", "blind/sim/1": "PASS", "deaf/sim/1": "FAIL"}

    def answer(place: OperatorPlace) -> dict[str, Any]:
        return {"name": place.name, "folder": str(place.folder), "finished": finished}

    monkeypatch.setattr(campaign_poller, "_status", answer)
    met = {"large": None, "blind": {"met": False}, "deaf": {"met": True}}
    runs = [
        {
            "case": case,
            "mode": "sim",
            "rep": 1,
            "verdict": finished[f"{case}/sim/1"],
            "control": how,
        }
        for case, how in met.items()
    ]
    for run in runs:
        write(tmp_path / f"{run['case']}/sim/1/result.json", run)
    with CampaignPoller(FlightScope()) as poller:
        with CampaignRecord(name="gate", folder=tmp_path):
            (flying,) = poller.poll()["campaigns"]
        assert flying["controls"] == {"blind/sim/1": False, "deaf/sim/1": True}
        write(tmp_path / "summary.json", {"runs": runs[:1], "controls": runs[1:]})
        (ended,) = poller.poll()["campaigns"]
        assert ended["controls"] == {"blind/sim/1": False, "deaf/sim/1": True}
