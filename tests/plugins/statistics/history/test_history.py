"""history: campaigns over time, flaky told apart from stochastic, a file that outlives folders."""

import itertools
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.full_disk import files_no_larger_than
from tests.orchestrator.reading.flown_campaign import (
    flights,
    write_control,
    write_flown,
    write_searched,
    write_summary_anew,
)
from tests.orchestrator.report.rendering.test_overview import CLEAR, FAST, judged
from tests.orchestrator.run_results.test_flown_firmware import BOARD
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.run_results.control_results import ControlResult
from wil_campaign.plugins.statistics.history.records import flight_records_of

Capture = pytest.CaptureFixture[str]
HOSTILE = "<script>alert(1)</script>\x1b[31m"


def flown(tmp_path: Path, day: int, verdicts: str, **more: Any) -> Path:
    spread = [0.01 * n for n in range(len(verdicts))]
    return write_flown(
        tmp_path / f"results/gate/2026110{day}",
        flights("a", "wil", verdicts, spread),
        started_utc=f"2026-11-0{day}T10:00:00Z",
        with_motion=False,
        **more,
    )


def shown(capsys: Capture, *arguments: object, code: int = 0) -> dict[str, Any]:
    assert main(["history", *map(str, arguments), "--json"]) == code
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_campaigns_stand_in_their_order_with_their_figures(tmp_path: Path, capsys: Capture) -> None:
    flown(tmp_path, 2, "PFP", version="1.1")
    flown(tmp_path, 1, "PPPI", version="1.0")
    rows = shown(capsys, tmp_path / "results")["rows"]
    assert [(row["started_utc"][:10], row["version"]) for row in rows] == [
        ("2026-11-01", "1.0"),
        ("2026-11-02", "1.1"),
    ]
    assert [(row["passed"], row["flown"], row["unproven"]) for row in rows] == [
        (3, 3, 1),
        (2, 3, 0),
    ]
    assert rows[0]["margin"] == pytest.approx(0.29)
    assert rows[0]["duration_s"] == pytest.approx(10.01)


def test_a_line_has_the_first_digits_of_the_commit(tmp_path: Path, capsys: Capture) -> None:
    for day, letter in ((1, "a"), (2, "b")):
        flown(tmp_path, day, "PFP", version=f"1.0 (commit {letter * 40}-dirty, code {'c' * 16})")
    rows = shown(capsys, tmp_path / "results")["rows"]
    assert [row["version"] for row in rows] == [
        f"1.0 (commit {letter * 12}-dirty, code {'c' * 16})" for letter in "ab"
    ]


@pytest.mark.parametrize("folder", ["results", "results/gate", "results/gate/search"])
def test_a_search_is_no_campaign_of_the_history(
    tmp_path: Path, capsys: Capture, folder: str
) -> None:
    flown(tmp_path, 1, "PPP")
    write_searched(tmp_path / "results/gate", started_utc="2026-11-02T10:00:00Z")
    if folder.endswith("search"):
        assert main(["history", str(tmp_path / folder)]) == 2
        assert "no flights of a campaign in" in capsys.readouterr().err
    else:
        rows = shown(capsys, tmp_path / folder)["rows"]
        assert [(row["case"], row["passed"]) for row in rows] == [("a", 3)]


def test_flaky_is_the_same_seed_and_stochastic_is_another(tmp_path: Path, capsys: Capture) -> None:
    flown(tmp_path, 1, "PFP")
    flown(tmp_path, 2, "PFF")
    varied = shown(capsys, tmp_path / "results")["variations"]
    assert [one["kind"] for one in varied] == ["flaky", "stochastic"]
    assert varied[0]["text"].startswith("seed 103: PASS in 2026-11-01T10:00:00Z #3, FAIL in")
    assert "2 seeds" not in varied[1]["text"]


@pytest.mark.parametrize(
    ("change", "kinds"),
    [
        ({"version": "2.0"}, ["stochastic", "stochastic"]),
        ({"documents": lambda _: "sha256:1"}, ["stochastic", "stochastic"]),
        ({"clock": "wall"}, ["stochastic", "stochastic"]),
        ({}, ["flaky", "stochastic"]),
    ],
)
def test_other_inputs_are_not_the_same_flight(
    tmp_path: Path, capsys: Capture, change: dict[str, Any], kinds: list[str]
) -> None:
    flown(tmp_path, 1, "PFP")
    flown(tmp_path, 2, "PFF", **change)
    varied = shown(capsys, tmp_path / "results")["variations"]
    assert [one["kind"] for one in varied] == kinds


def test_nothing_is_called_flaky_on_the_wall_clock(tmp_path: Path, capsys: Capture) -> None:
    flown(tmp_path, 1, "PPP", clock="wall")
    flown(tmp_path, 2, "PPF", clock="wall")
    (one,) = shown(capsys, tmp_path / "results")["variations"]
    assert one["kind"] == "stochastic"
    assert "a seed does not repeat a flight" in one["text"]


def test_a_device_is_no_history(tmp_path: Path, capsys: Capture) -> None:
    """/dev/zero was read for ever."""
    assert main(["history", str(tmp_path), "--keep", "/dev/null"]) == 2
    assert "/dev/null is not a file" in capsys.readouterr().err


def test_a_file_keeps_what_folders_lose_and_takes_nothing_twice(
    tmp_path: Path, capsys: Capture
) -> None:
    keep = tmp_path / "history.jsonl"
    first = flown(tmp_path, 1, "PPP")
    shown(capsys, tmp_path / "results", "--keep", keep)
    first.rename(tmp_path / "gone")
    flown(tmp_path, 2, "PPF")
    rows = shown(capsys, tmp_path / "results", "--keep", keep)["rows"]
    assert [row["passed"] for row in rows] == [3, 2]
    shown(capsys, tmp_path / "results", "--keep", keep)
    assert len(keep.read_text().splitlines()) == 6


def test_a_flight_that_was_flown_again_counts_as_it_ended_last(
    tmp_path: Path, capsys: Capture
) -> None:
    keep = tmp_path / "history.jsonl"
    shutil.rmtree(shown_once(tmp_path, capsys, keep, "PPI", code=3, stopped="signal"))
    shutil.rmtree(shown_once(tmp_path, capsys, keep, "PPF"))
    lines = [json.loads(line) for line in keep.read_text().splitlines()]
    assert [one["verdict"] for one in lines[2::3]] == ["INVALID", "FAIL"]
    (row,) = shown(capsys, tmp_path / "results", "--keep", keep)["rows"]
    assert (row["passed"], row["flown"], row["unproven"], row["ending"]) == (2, 3, 0, "")
    assert len(keep.read_text().splitlines()) == 6
    # An older copy of the folder is no news.
    shutil.rmtree(tmp_path / "results")
    flown(tmp_path, 1, "PPI", stopped="signal")
    (row,) = shown(capsys, tmp_path / "results", "--keep", keep, code=3)["rows"]
    assert (row["passed"], row["flown"], row["unproven"]) == (2, 3, 0)


def shown_once(
    tmp_path: Path, capsys: Capture, keep: Path, verdicts: str, *, code: int = 0, **more: Any
) -> Path:
    folder = flown(tmp_path, 1, verdicts, **more)
    shown(capsys, tmp_path / "results", "--keep", keep, code=code)
    return folder


def test_two_machines_that_start_in_one_second_are_two_campaigns(
    tmp_path: Path, capsys: Capture
) -> None:
    keep = tmp_path / "history.jsonl"
    shutil.rmtree(shown_once(tmp_path, capsys, keep, "PPP", host="one"))
    shutil.rmtree(shown_once(tmp_path, capsys, keep, "PFF", host="two"))
    rows = shown(capsys, tmp_path / "results", "--keep", keep)["rows"]
    assert [(row["passed"], row["flown"]) for row in rows] == [(3, 3), (1, 3)]


def test_campaigns_that_one_machine_starts_in_one_second_are_several(
    tmp_path: Path, capsys: Capture
) -> None:
    """As over seeds, over options, or over versions of an autonomy."""
    keep = tmp_path / "history.jsonl"
    one, seed, option = (flights("a", "wil", verdicts) for verdicts in ("PPP", "PFF", "FFF"))
    write_flown(tmp_path / "results/1", one)
    write_flown(tmp_path / "results/2", [replace(flight, seed=7 + flight.rep) for flight in seed])
    write_flown(tmp_path / "results/3", option, documents=lambda _: "sha256:1")
    for _ in range(2):
        (row,) = shown(capsys, tmp_path / "results", "--keep", keep)["rows"]
        assert (row["passed"], row["flown"]) == (4, 9)


@pytest.mark.parametrize("lacking", [("plan",), ("plan", "host")])
def test_a_line_of_an_earlier_version_is_the_same_flight(
    tmp_path: Path, capsys: Capture, lacking: tuple[str, ...]
) -> None:
    keep = tmp_path / "history.jsonl"
    shown_once(tmp_path, capsys, keep, "PPF")
    lines = [json.loads(line) for line in keep.read_text().splitlines()]
    for one, key in itertools.product(lines, lacking):
        del one[key]
    keep.write_text("".join(json.dumps(one) + "\n" for one in lines))
    (row,) = shown(capsys, tmp_path / "results", "--keep", keep)["rows"]
    assert row["flown"] == 3


def test_the_page_acts_on_nothing_from_a_file(tmp_path: Path, capsys: Capture) -> None:
    flown(tmp_path, 1, "PFP", version=HOSTILE)
    page = tmp_path / "history.html"
    assert main(["history", str(tmp_path / "results"), "--page", str(page)]) == 0
    outcome = capsys.readouterr()
    assert "\x1b" not in outcome.out
    text = page.read_text()
    assert "<script" not in text
    assert "&lt;script&gt;" in text
    assert "stochastic" in text
    assert not re.search(r'(src|href)="(?!data:,)', text)


def test_the_page_draws_intervals_and_links_to_reports(tmp_path: Path) -> None:
    first = flown(tmp_path, 1, "PFP", document={"oracles": {"altitude": {"max_m": 2}}})
    (first / "report.html").write_text("<!doctype html>")
    flown(tmp_path, 2, "PPP", document={"oracles": {"altitude": {"max_m": 3}}})
    page = tmp_path / "pages" / "history.html"
    page.parent.mkdir()
    assert main(["history", str(tmp_path / "results"), "--page", str(page)]) == 0
    text = page.read_text()
    assert re.findall(r'href="(?!data)([^"]*)"', text) == ["../results/gate/20261101/report.html"]
    bars = [float(y) for y in re.findall(r'class="interval"[^>]*y1="([\d.]+)"', text)]
    # 2 of 3: from 9.4 %; 3 of 3: from 29.2 %; of 48 px, 8 px from the top.
    assert bars == pytest.approx([8 + 48 * (1 - 0.094), 8 + 48 * (1 - 0.292)], abs=0.1)
    assert text.count('<line class="changed"') == 1
    assert "2 of 2" not in text


def test_a_full_disk_takes_all_of_the_new_flights_or_none(tmp_path: Path, capsys: Capture) -> None:
    keep = tmp_path / "history.jsonl"
    shown_once(tmp_path, capsys, keep, "PPP")
    keep.write_text(kept := keep.read_text().removesuffix("\n"))  # as an editor leaves it
    flown(tmp_path, 2, "PFP")
    with files_no_larger_than(len(kept) + 1000):
        assert main(["history", str(tmp_path / "results"), "--keep", str(keep)]) == 2
    assert f"{keep} cannot be written: File too large" in capsys.readouterr().err
    assert keep.read_text() == kept
    for _ in range(2):
        rows = shown(capsys, tmp_path / "results", "--keep", keep)["rows"]
        assert [(row["passed"], row["flown"]) for row in rows] == [(3, 3), (2, 3)]


@pytest.mark.parametrize("content", ["{", '{"campaign": "gate"}', "\udce9"])
def test_a_damaged_file_is_named_with_its_line(
    tmp_path: Path, capsys: Capture, content: str
) -> None:
    keep = tmp_path / "history.jsonl"
    keep.write_bytes(content.encode("utf-8", "surrogateescape"))
    assert main(["history", str(flown(tmp_path, 1, "PP")), "--keep", str(keep)]) == 2
    assert "history.jsonl" in capsys.readouterr().err
    assert keep.read_bytes() == content.encode("utf-8", "surrogateescape")


def test_a_campaign_that_did_not_come_to_its_end_is_named(tmp_path: Path, capsys: Capture) -> None:
    stopped = flown(tmp_path, 1, "PPP", stopped="command")
    flown(tmp_path, 2, "PPP")
    keep, page = tmp_path / "history.jsonl", tmp_path / "page.html"
    command = ["history", str(tmp_path / "results"), "--keep", str(keep), "--page", str(page)]
    assert main(command) == 3
    outcome = capsys.readouterr()
    said = "stopped by an operator's command"
    assert f"gate of 2026-11-01T10:00:00Z: {said}" in outcome.out
    assert "gate of 2026-11-02" not in outcome.out
    assert outcome.err == f"{stopped}: {said}\n"
    assert "stopped by an operator" in page.read_text()
    # The file keeps it when the folder is gone, and an old line of it does not say.
    shutil.rmtree(tmp_path / "results")
    flown(tmp_path, 3, "PPP", broken=None)
    lines = keep.read_text().splitlines()
    old = {key: load for key, load in json.loads(lines[-1]).items() if key != "ending"}
    keep.write_text("\n".join([*lines[:3], json.dumps(old)]) + "\n")
    assert main(command) == 0
    text = capsys.readouterr().out
    assert f"gate of 2026-11-01T10:00:00Z: {said}" in text
    assert "gate of 2026-11-02T10:00:00Z: how it ended is unknown" in text
    assert "gate of 2026-11-03T10:00:00Z: summary.json does not record the end" in text


def test_nothing_to_show_and_damaged_folders(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "results").mkdir()
    assert main(["history", str(tmp_path / "results")]) == 2
    assert main(["history", str(tmp_path / "nowhere")]) == 2
    assert "nowhere is not a folder" in capsys.readouterr().err
    folder = flown(tmp_path, 1, "PP")
    (folder / "a/wil/2/result.json").write_text("{")
    (folder / "summary.json").unlink()
    page = tmp_path / "page.html"
    assert main(["history", str(tmp_path / "results"), "--page", str(page)]) == 3
    outcome = capsys.readouterr()
    assert "1/1" in outcome.out
    assert "a/wil/2: result.json is truncated" in outcome.err
    assert "a/wil/2: result.json is truncated" in page.read_text()


def test_an_interval_is_of_proven_flights_only(tmp_path: Path, capsys: Capture) -> None:
    flown(tmp_path, 1, "II")
    page = tmp_path / "page.html"
    assert main(["history", str(tmp_path / "results"), "--page", str(page)]) == 0
    assert "0/0 +2 unproven  -" in capsys.readouterr().out
    assert "0/0 <small>+2 unproven</small>" in page.read_text()
    assert "equal runs" not in page.read_text()


def test_flights_by_other_settings_are_not_of_one_line(tmp_path: Path, capsys: Capture) -> None:
    """A weaker limit makes passes of failures: the curve is another one from there on."""
    limits = [{"max_m": 2.3}, {"max_m": 2.3}, {"max_m": 5.0}]
    for day, limit in enumerate(limits, 1):
        flown(tmp_path, day, "PPF", document={"oracles": {"altitude": limit}, "description": day})
    rows = shown(capsys, tmp_path / "results", "--page", tmp_path / "page.html")["rows"]
    assert [row["is_other"] for row in rows] == [False, False, True]
    assert rows[0]["settings"] == rows[1]["settings"] != rows[2]["settings"]
    page = (tmp_path / "page.html").read_text()
    assert (page.count("<polyline"), page.count("other settings than before")) == (2, 1)
    assert main(["history", str(tmp_path / "results")]) == 0
    said = "other settings than before: gate a wil from 2026-11-03T10:00:00Z on\n"
    assert said in capsys.readouterr().out


def test_the_history_keeps_metres_in_which_flights_are_compared(tmp_path: Path) -> None:
    folder = write_flown(tmp_path / "a", flights("a", "wil", "F"), with_motion=False)
    (folder / "a/wil/1/result.json").write_text(to_json(judged(CLEAR, FAST)))
    (record,) = flight_records_of(read_campaign_documents(folder))
    assert record.margin == 0.4


def test_the_seconds_of_a_flight_that_came_near_nothing_are_no_metres(
    tmp_path: Path, capsys: Capture
) -> None:
    """The median of 0.4 m and twice 9 s was 9."""
    folder = write_flown(
        tmp_path / "a", flights("a", "wil", "PPP", (0.0, 0.1, 0.2)), with_motion=False
    )
    in_time, far = ("time_limit", "s", 9.0, True), ("clearance", "m", None, True)
    for rep, clear in ((1, CLEAR), (2, far), (3, far)):
        result = replace(judged(clear, in_time), verdict="PASS", rep=rep, seed=100 + rep)
        (folder / f"a/wil/{rep}/result.json").write_text(to_json(result))
    write_summary_anew(folder)
    (row,) = shown(capsys, folder)["rows"]
    assert row["margin"] == 0.4
    for rep in (1, 2, 3):
        result = replace(judged(far, in_time), verdict="PASS", rep=rep, seed=100 + rep)
        (folder / f"a/wil/{rep}/result.json").write_text(to_json(result))
    write_summary_anew(folder)
    (row,) = shown(capsys, folder)["rows"]
    assert row["margin"] == 9.0


@pytest.mark.parametrize("met", [True, False])
def test_the_passes_of_a_campaign_that_cannot_fail_say_so(
    tmp_path: Path, capsys: Capture, met: bool
) -> None:
    folder = flown(tmp_path, 1, "PPP")
    blind = flights("blind", "wil", "F" if met else "P")[0].result()
    control = ControlResult("a", "FAIL", oracle=None, cause=None, met=met)
    write_control(folder, replace(blind, required=False, control=control))
    page = tmp_path / "page.html"
    assert main(["history", str(folder), "--page", str(page)]) == 0
    said = "this campaign cannot fail: control blind in mode wil passed"
    assert (f"gate of 2026-11-01T10:00:00Z: {said}\n" in capsys.readouterr().out) is not met
    assert (said in page.read_text()) is not met


def with_firmware(tmp_path: Path, day: int, version: str | None, verdicts: str = "PP") -> Path:
    firmware = () if version is None else (replace(BOARD, version=version),)
    return write_flown(
        tmp_path / f"results/gate/2026110{day}",
        flights("a", "wil", verdicts, [0.0, 0.1], firmware=firmware),
        started_utc=f"2026-11-0{day}T10:00:00Z",
        with_motion=False,
    )


def test_another_firmware_is_marked(tmp_path: Path, capsys: Capture) -> None:
    for day, version in enumerate((None, "4.6.1", "4.6.1", "4.6.2"), 1):
        with_firmware(tmp_path, day, version)
    rows = shown(capsys, tmp_path / "results")["rows"]
    assert [row["other_firmware"] for row in rows] == [False, False, False, True]
    assert [row["is_other"] for row in rows] == [False] * 4
    assert rows[3]["firmware"].startswith("real: ardupilot 4.6.2")
    page = tmp_path / "history.html"
    assert main(["history", str(tmp_path / "results"), "--page", str(page)]) == 0
    assert "other firmware than before: gate a wil from 2026-11-04" in capsys.readouterr().out
    assert page.read_text().count("other firmware than before") == 1
    assert page.read_text().count("<polyline") == 2


def test_another_firmware_is_no_flake(tmp_path: Path, capsys: Capture) -> None:
    with_firmware(tmp_path, 1, "4.6.1", "PP")
    with_firmware(tmp_path, 2, "4.6.2", "FP")
    varied = shown(capsys, tmp_path / "results")["variations"]
    assert [one["kind"] for one in varied] == ["stochastic"]
    with_firmware(tmp_path, 3, "4.6.2", "PP")
    varied = shown(capsys, tmp_path / "results")["variations"]
    assert [one["kind"] for one in varied][:1] == ["flaky"]


def test_a_line_of_an_earlier_version_keeps_its_inputs(tmp_path: Path) -> None:
    (old, *_) = flight_records_of(read_campaign_documents(with_firmware(tmp_path, 1, None)))
    (new, *_) = flight_records_of(read_campaign_documents(with_firmware(tmp_path, 2, "4.6.1")))
    assert (old.firmware, old.inputs) == ("", "64fd6ecdec068cf7")
    assert new.inputs != old.inputs
