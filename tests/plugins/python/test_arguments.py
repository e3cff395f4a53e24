"""Arguments of programs: one text where several may stand, and calls that are cancelled."""

from pathlib import Path
from typing import Any

import pytest

import wil_campaign
from wil_campaign.orchestrator.campaign.flight_options import USUAL
from wil_campaign.plugins.python.flying import FlightProcess, flight_options_with

GATE = "campaigns/gate.yaml"


def test_one_text_is_no_list_of_letters() -> None:
    campaign = wil_campaign.load(GATE, cases="large", modes="sim")  # type: ignore[arg-type]
    assert {(plan.case, plan.mode) for plan in campaign.runs} == {("large", "sim")}
    chosen = flight_options_with(USUAL, {"runs": "large/sim/1", "resume": True, "again": "a/sim/1"})
    assert (chosen.runs, chosen.again) == (("large/sim/1",), ("a/sim/1",))
    with pytest.raises(wil_campaign.BadInput, match=r"^hall\.yaml: cannot be read"):
        wil_campaign.load(GATE, bench_files=Path("hall.yaml"))  # type: ignore[arg-type]


def test_runs_are_not_flown_again_without_resuming() -> None:
    """The command refuses it; here it was passed over, and all runs flew."""
    with pytest.raises(ValueError, match="needs resume=True"):
        flight_options_with(USUAL, {"again": ["large/sim/1"]})


def test_a_flight_that_is_stopped_as_its_process_ends_raises_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A call that was cancelled then raised ValueError: write to closed file."""
    process = FlightProcess(b"", module="this")
    wait = process._process.wait

    def cancelled(*arguments: Any) -> int:
        process.stop()
        return int(wait(*arguments))

    monkeypatch.setattr(process._process, "wait", cancelled)
    with process:
        pass
