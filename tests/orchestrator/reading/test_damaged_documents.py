"""Documents of a results folder that are damaged, foreign or hostile: named, never an exception."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.reading.flown_campaign import flights, write_flown
from wil_campaign.campaigns.values.acceptance import PassRequirement, PassShare
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.cli import main

Capture = pytest.CaptureFixture[str]
Document = dict[str, Any]
COMMANDS = ("report", "gap", "compare", "history")


def flown(folder: Path) -> Path:
    given = [
        flight
        for mode, shift in (("real", 0.0), ("wil", 0.1), ("sim", 0.4))
        for flight in flights("a", mode, "PP", [shift, shift + 0.01])
    ]
    return write_flown(folder, given, with_motion=False)


def changed(path: Path, change: Callable[[Document], object]) -> None:
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


def outcome(capsys: Capture, command: str, folder: Path) -> tuple[int, str]:
    """Run a command on a folder in its plainest form; return exit code and standard error."""
    good = folder.parent / "good"
    if command == "compare" and not good.exists():
        flown(good)
    before = [str(good)] if command == "compare" else []
    code = main([command, *before, str(folder)])
    text = capsys.readouterr().err
    assert "internal error" not in text
    return code, text


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda document: document.clear(), "it lacks campaign, started_utc, runs, document"),
        (lambda document: document.update(started_utc=7), "it lacks started_utc"),
        (lambda document: document.update(runs={}), "it lacks runs"),
        (lambda document: document.update(requirements=7), "requirements: Input should be a valid"),
        (
            lambda document: document.update(requirements=[{"case": "a", "mode": "wil"}]),
            "requirements.0.share: Field required",
        ),
        (
            lambda document: document["runs"].extend(
                [{"run": "../../etc"}, {"run": "a\ud800/wil/" + "1" * 300}, {"run": 5}, None]
            ),
            "4 runs that are not named case/mode/repetition: '../../etc', 'a?/wil/1",
        ),
    ],
)
def test_a_campaign_file_of_another_shape_is_named(
    tmp_path: Path, capsys: Capture, change: Callable[[Document], object], words: str
) -> None:
    folder = flown(tmp_path / "gate")
    changed(folder / "campaign.json", change)
    for command in COMMANDS:
        code, text = outcome(capsys, command, folder)
        assert (command, code) == (command, 3)
        assert words in text


@pytest.mark.parametrize(
    ("number", "words"),
    [("NaN", "NaN is not a number"), ("1e999", "1e999 is too large")],
)
def test_a_result_with_a_value_that_is_no_number_is_damaged(
    tmp_path: Path, capsys: Capture, number: str, words: str
) -> None:
    folder = flown(tmp_path / "gate")
    path = folder / "a/real/1/result.json"
    written = path.read_text()
    path.write_text(written.replace('"duration_s": 10.0', f'"duration_s": {number}', 1))
    assert path.read_text() != written
    for command in COMMANDS:
        code, text = outcome(capsys, command, folder)
        assert (command, code) == (command, 3)
        assert f"a/real/1: result.json is truncated or damaged: {words}" in text


def test_half_a_surrogate_pair_spoils_no_kept_history(tmp_path: Path, capsys: Capture) -> None:
    folder = flown(tmp_path / "gate")
    changed(folder / "campaign.json", lambda document: document.update(campaign="a\ud800b"))
    changed(folder / "summary.json", lambda document: document.update(campaign="a?b"))
    keep = tmp_path / "history.jsonl"
    for _ in range(2):
        assert main(["history", str(folder), "--keep", str(keep), "--json"]) == 0
        rows = json.loads(capsys.readouterr().out)["rows"]
        assert {row["campaign"] for row in rows} == {"a?b"}
    assert main(["report", str(folder)]) == 3


def test_a_folder_that_lost_its_campaign_file_is_not_passed_over(
    tmp_path: Path, capsys: Capture
) -> None:
    folder = flown(tmp_path / "gate")
    (folder / "campaign.json").unlink()
    assert main(["history", str(tmp_path)]) == 3
    text = capsys.readouterr()
    assert "campaign.json is missing" in text.err
    assert "2/2" in text.out


def test_the_result_of_another_run_is_not_counted(tmp_path: Path, capsys: Capture) -> None:
    folder = flown(tmp_path / "gate")
    (other,) = flights("a", "real", "P", seed=900)
    for text in ((folder / "a/real/2/result.json").read_text(), to_json(other.result())):
        (folder / "a/real/1/result.json").write_text(text)
        for command in COMMANDS:
            code, said = outcome(capsys, command, folder)
            assert (command, code) == (command, 3)
            assert "a/real/1: result.json is of another run" in said


def test_a_run_that_its_campaign_does_not_count_is_counted_nowhere(
    tmp_path: Path, capsys: Capture
) -> None:
    """It was flown after a decision, and its program was killed; or somebody has put it there."""
    folder = flown(tmp_path / "gate")
    for place, run in (("a/real/2", "a/real/3"), ("a/real/1", "b/real/1")):
        shutil.copytree(folder / place, folder / run)
        path = folder / run / "result.json"
        document = json.loads(path.read_text()) | {"case": run[0], "rep": int(run[-1])}
        path.write_text(json.dumps(document))
    for command in COMMANDS:
        code, said = outcome(capsys, command, folder)
        assert (command, code) == (command, 3)
        assert "not counted: a/real/3, b/real/1; " in said
    main(["history", str(folder), "--json"])
    assert sum(row["flown"] for row in json.loads(capsys.readouterr().out)["rows"]) == 6


def test_another_flight_of_the_same_seed_and_verdict_gives_no_verdict(
    tmp_path: Path, capsys: Capture
) -> None:
    """As a run's folder copied from the campaign of another day, or a result edited by hand."""
    folder = flown(tmp_path / "gate")
    changed(folder / "a/wil/2/result.json", lambda result: result.update(duration_s=11.0))
    for command in COMMANDS:
        code, said = outcome(capsys, command, folder)
        assert (command, code) == (command, 3)
        assert "a/wil/2 has other figures there than in its result.json" in said
    assert "no verdict" in (folder / "report.html").read_text()


@pytest.mark.parametrize(("flown_as", "share"), [("PF", 2), ("PI", 1)])
def test_a_summary_that_accepts_what_is_not_accepted_gives_no_verdict(
    tmp_path: Path, capsys: Capture, flown_as: str, share: int
) -> None:
    """Its page was green, and said that one of the two required runs passed."""
    asked = [PassRequirement("a", "wil", PassShare(share, 2))]
    given = flights("a", "wil", flown_as)
    folder = write_flown(tmp_path / "gate", given, with_motion=False, requirements=asked)
    said = "summary.json is damaged: it says accepted, and its runs do not meet"
    assert main(["report", str(folder)]) == 3  # nothing is recorded
    assert said not in capsys.readouterr().err
    changed(folder / "summary.json", lambda summary: summary.update(accepted=True))
    assert main(["report", str(folder)]) == 3
    assert said in capsys.readouterr().err
    assert "no verdict" in (folder / "report.html").read_text()


@pytest.mark.parametrize("other", ["b", "gate"])
def test_a_summary_of_other_flights_gives_no_verdict(
    tmp_path: Path, capsys: Capture, other: str
) -> None:
    """As where a folder was put together of copies."""
    folder = flown(tmp_path / "gate")
    given = [*flights("a", "real", "PF"), *flights("a", "wil", "PP"), *flights("a", "sim", "PP")]
    foreign = write_flown(tmp_path / "foreign", given, name=other, with_motion=False)
    shutil.copy(foreign / "summary.json", folder)
    for command in COMMANDS:
        code, said = outcome(capsys, command, folder)
        assert (command, code) == (command, 3)
        assert "summary.json is of other flights" in said
    assert "no verdict" in (folder / "report.html").read_text()
