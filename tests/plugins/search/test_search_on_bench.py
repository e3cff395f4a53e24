"""A search on a bench: a person consents before each flight of its vehicle, behind a socket."""

import io
import json
import sys
from pathlib import Path

import pytest

from tests.plugins.cluster.bench.test_bench_engine import write_bench
from tests.plugins.cluster.bench.test_bench_flight import vehicle_at
from tests.plugins.search.test_search_places import BRIEF, document_of, write_asking
from tests.ports import free_port
from wil_campaign.campaigns.setup.bench_file import load_benches
from wil_campaign.orchestrator.campaign.folder.bench_lock import held_benches
from wil_campaign.orchestrator.cli import main


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def write_for_hardware(folder: Path, port: int) -> list[str]:
    """Write a search of two variants on a bench; return the words that search with it."""
    budget = ("sim: 2", "real: 2")
    path, _ = write_asking(folder, BRIEF.replace(*budget))
    bench = str(write_bench(folder, port).document.path)
    words = ["search", str(path), "--out", str(folder / "out"), "--bench-file", bench]
    return [*words, "--set", "preflight.failsafe=set", "--arm-real"]


def test_a_search_on_hardware_needs_a_person_at_the_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = write_for_hardware(tmp_path, free_port())
    assert main(words[:-1]) == 2
    assert "flies no attached vehicle without --arm-real" in capsys.readouterr().err
    assert main(words) == 2
    assert "only with a person at a terminal" in capsys.readouterr().err
    monkeypatch.setattr(sys, "stdin", Terminal())
    monkeypatch.setattr(sys, "stderr", screen := Terminal())
    assert main([*words, "--engine", "ray"]) == 2
    assert "search there with --engine local" in screen.getvalue()
    assert not (tmp_path / "out").exists()


def test_a_search_on_a_bench_in_use_is_refused_before_its_vehicle_is_touched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = write_for_hardware(tmp_path, free_port())
    monkeypatch.setattr(sys, "stdin", Terminal("y\n"))
    monkeypatch.setattr(sys, "stderr", screen := Terminal())
    bench = load_benches([Path(words[words.index("--bench-file") + 1])])
    with held_benches(bench):
        assert main(words) == 3
    assert screen.getvalue().startswith("bench hall-a is in use by another wil-campaign")


def test_a_search_on_a_bench_asks_before_each_flight_and_ends_without_consent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    port = free_port()
    words = write_for_hardware(tmp_path, port)
    monkeypatch.setattr(sys, "stdin", Terminal("y\nno\n"))
    monkeypatch.setattr(sys, "stderr", screen := Terminal())
    with vehicle_at(port):
        assert main(words) == 4
    asked = "campaign 'hover', 1 run. Arm real"
    assert screen.getvalue().count(asked) == 2
    said = capsys.readouterr().out
    assert said.count("bring the vehicles back to their starts") == 2
    assert "not confirmed; nothing was armed; the search ends" in said
    (flown,) = (tmp_path / "out").glob("hover/search/*/flights/*/*/real/*/result.json")
    result = json.loads(flown.read_text())
    assert result["verdict"] in {"PASS", "FAIL"}, result["reason"]
    document = document_of(tmp_path / "out")
    assert [one["flights"] for one in document["costs"]] == [1]
