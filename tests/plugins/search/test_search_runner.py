"""A search flown by an engine that flies nothing: what is written, resumed, and its exit codes."""

import itertools
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.plugins.search.exploration.made_up import number, plane, problem, searched
from tests.plugins.search.searches import SEARCH, MadeUpEngine, write_search
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.folder.campaign_folder import OutputError
from wil_campaign.orchestrator.campaign.folder.manifest import file_digest
from wil_campaign.orchestrator.campaign.resuming.unchanged_campaign import ResumeError
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.cli.arming_consent import FlightRefusedError
from wil_campaign.plugins.search.errors import SearchError
from wil_campaign.plugins.search.exploration.search_file import load_search
from wil_campaign.plugins.search.exploration.space import Values
from wil_campaign.plugins.search.ledger import FILE_NAME as LEDGER
from wil_campaign.plugins.search.report.search_report import write_search_page
from wil_campaign.plugins.search.search_command import search_text
from wil_campaign.plugins.search.search_document import unsettled_texts
from wil_campaign.plugins.search.search_runner import SearchOutcome, fly_search, search_exit_code
from wil_campaign.safety.model.oracle_results import Verdict

TPE = SEARCH.replace("strategy: grid", "strategy: tpe").replace("sim: 3", "sim: 4")


class KilledError(Exception):
    """Ends a search as kill -9 does: nothing after it is written."""


def flown(
    path: Path,
    engine: MadeUpEngine,
    *,
    resume: bool = False,
    at_once: int = 2,
    sets: tuple[str, ...] = (),
) -> SearchOutcome:
    options = FlightOptions(out=path.parent / "out", resume=resume)
    search = load_search(path, ExpansionOptions(sets=sets))
    return fly_search(search, options, ClearedCampaign("virtual", at_once), engine, lambda _: None)


def document(outcome: SearchOutcome) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((outcome.folder / "search.json").read_text())
    return found


def test_a_search_leaves_what_it_found_and_a_file_that_is_a_campaign(tmp_path: Path) -> None:
    outcome = flown(write_search(tmp_path), MadeUpEngine())
    assert outcome.exit_code == 1
    assert outcome.folder.parent == tmp_path / "out" / "hover" / "search"
    found = document(outcome)
    (failure,) = found["failures"]
    assert (failure["standing"], failure["failed"], failure["proven"]) == ("confirmed", 2, 2)
    assert failure["cause"] == "altitude/twin"
    assert failure["values"] == {"height": 2.0}
    # Half way to the campaign's own 1.2 m, as far as the flights go.
    assert failure["reduced"]["keys"] == {"goal.altitude_m": 1.6}
    assert not failure["reduced"]["is_smallest"]
    flown_in_sim = [one["modes"]["sim"] for one in found["variants"]]
    assert sorted((*one["verdicts"], *one["causes"]) for one in flown_in_sim) == [
        ("FAIL", "altitude/twin"),
        ("FAIL", "altitude/twin"),
        ("PASS", ""),
    ]
    campaign = load_campaign(outcome.folder / failure["file"])
    assert [plan.name for plan in campaign.runs] == [
        f"failure-{failure['name']}/sim/{repetition}" for repetition in (1, 2)
    ]
    assert all(plan.required for plan in campaign.runs)
    assert campaign.setups[campaign.cases[0]].goal.altitude_m == 1.6


def test_a_search_killed_at_any_batch_goes_on_as_if_it_had_not_been(tmp_path: Path) -> None:
    whole = MadeUpEngine()
    path = write_search(tmp_path, TPE)
    expected = document(flown(path, whole))
    for at in range(1, 8):
        folder = tmp_path / f"killed-{at}"
        folder.mkdir()
        path = write_search(folder, TPE)

        def kill(batch: int, at: int = at) -> None:
            if batch == at:
                raise KilledError

        killed = MadeUpEngine(before=kill)
        try:
            flown(path, killed)
        except KilledError:
            (ledger,) = folder.rglob(LEDGER)
            # What was being written is cut off in the middle of a line.
            ledger.write_text(ledger.read_text() + '{"flown": 99, "outc')
            rest = MadeUpEngine()
            outcome = flown(path, rest, resume=True, at_once=7)
            assert document(outcome) == expected
            assert killed.flown + rest.flown == whole.flown
            nothing = MadeUpEngine()
            assert document(flown(path, nothing, resume=True)) == expected
            assert nothing.flown == []
        else:
            assert killed.flown == whole.flown
            break
    else:
        pytest.fail("the search never ended")


def test_a_search_is_not_resumed_with_another_file(tmp_path: Path) -> None:
    path = write_search(tmp_path)
    flown(path, MadeUpEngine(stopped=lambda batch: "signal" if batch == 2 else None))
    path.write_text(path.read_text().replace("sim: 3", "sim: 4"))
    with pytest.raises(ResumeError, match=r"hover\.yaml changed"):
        flown(path, MadeUpEngine(), resume=True)


@pytest.mark.parametrize("name", ["still.py", "world.yaml"])
def test_a_file_that_changes_in_a_flight_ends_the_search(tmp_path: Path, name: str) -> None:
    """Each batch reads its files anew, and would have flown another autonomy, another world."""
    path = write_search(tmp_path)
    original = (tmp_path / name).read_text()

    def edit(batch: int) -> None:
        if batch == 2:
            (tmp_path / name).write_text(f"{original}# changed\n")

    first = MadeUpEngine(before=edit)
    with pytest.raises(OutputError, match=f"{name} changed while the campaign flew"):
        flown(path, first)
    assert {one[:4] for one in first.flown} == {"0001", "0002"}
    (tmp_path / name).write_text(original)
    second = MadeUpEngine()
    assert flown(path, second, resume=True).exit_code == 1
    assert not set(first.flown) & set(second.flown)


def test_a_search_is_not_resumed_with_other_code_that_only_its_flights_imported(
    tmp_path: Path,
) -> None:
    """The manifest does not name it: the autonomy imports it in flight, by a name that it makes."""
    path = write_search(tmp_path)
    helper = tmp_path / "helper.py"
    helper.write_text("VZ = 0.0\n")
    code = {"helper.py": file_digest(helper)}
    stopped = MadeUpEngine(code=code, stopped=lambda batch: "signal" if batch == 2 else None)
    flown(path, stopped)
    helper.write_text("VZ = 0.5\n")
    with pytest.raises(ResumeError, match=r"helper\.py changed since its finished flights flew"):
        flown(path, MadeUpEngine(), resume=True)
    helper.write_text("VZ = 0.0\n")
    again = MadeUpEngine(code=code)
    assert flown(path, again, resume=True).exit_code == 1
    assert not set(stopped.flown) & set(again.flown)


def test_a_ledger_of_other_proposals_or_a_damaged_one_is_refused(tmp_path: Path) -> None:
    path = write_search(tmp_path)
    outcome = flown(path, MadeUpEngine(stopped=lambda batch: "signal" if batch == 3 else None))
    ledger = outcome.folder / LEDGER
    text = ledger.read_text()
    ledger.write_text(text.replace('"height": 2.0', '"height": 1.9'))
    with pytest.raises(SearchError, match="its batch 1 differs from what the"):
        flown(path, MadeUpEngine(), resume=True)
    ledger.write_text(text.replace('"verdict": "PASS"', '"verdict": "MAYBE"'))
    with pytest.raises(SearchError, match=r"line 3 of ledger\.jsonl is damaged"):
        flown(path, MadeUpEngine(), resume=True)
    ledger.write_text("")
    with pytest.raises(SearchError, match="is empty"):
        flown(path, MadeUpEngine(), resume=True)
    ledger.unlink()
    with pytest.raises(SearchError, match="cannot be read"):
        flown(path, MadeUpEngine(), resume=True)


@pytest.mark.parametrize(("stop", "code"), [("signal", 130), ("command", 4)])
def test_a_stopped_search_says_so_and_can_be_resumed(tmp_path: Path, stop: Any, code: int) -> None:
    path = write_search(tmp_path)
    first = MadeUpEngine(stopped=lambda batch: stop if batch == 2 else None)
    outcome = flown(path, first)
    assert outcome.exit_code == code
    assert "--resume" in document(outcome)["ended"]
    assert len(document(outcome)["variants"]) == 2
    second = MadeUpEngine()
    assert flown(path, second, resume=True).exit_code == 1
    assert not set(first.flown) & set(second.flown)


@pytest.mark.parametrize(
    ("strategy", "package"),
    [
        ("tpe", "optuna"),
        ("cma-es", "cmaes"),
        ("pairwise", "covertable"),
        ("grid", "scipy"),
    ],
)
def test_a_missing_extra_is_refused_with_the_remedy_before_anything_is_written(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    strategy: str,
    package: str,
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    two = SEARCH.replace(
        "  objective:", "    fast: {key: limits.speed_m_s, from: 1, to: 3}\n  objective:"
    )
    path = write_search(tmp_path, two.replace("strategy: grid", f"strategy: {strategy}"))
    out = tmp_path / "out"
    assert main(["search", str(path), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert f"needs the package {package}" in said
    assert "install wil-campaign[search]" in said
    assert not out.exists()


def test_validate_and_search_refuse_a_wrong_search_alike(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_search(tmp_path, SEARCH.replace("objective: altitude", "objective: landed"))
    place = f"{path}:13:14: oracle 'landed' judges an event and has no margin"
    for command in (["validate", str(path)], ["search", str(path), "--out", str(tmp_path / "out")]):
        assert main(command) == 2
        assert place in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_nothing_to_resume_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_search(tmp_path)
    assert main(["search", str(path), "--out", str(tmp_path), "--resume"]) == 2
    assert "nothing to resume" in capsys.readouterr().err


def test_an_attached_vehicle_is_not_searched_with(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_search(tmp_path)
    path.write_text(path.read_text().replace("link: embedded", "link: 'udpin://0.0.0.0:14550'"))
    assert main(["search", str(path), "--out", str(tmp_path / "out")]) == 2
    assert "a search flies no attached vehicle" in capsys.readouterr().err


def test_ctrl_c_between_two_batches_is_an_interrupt(tmp_path: Path) -> None:
    def interrupt(batch: int) -> None:
        if batch == 2:
            raise KeyboardInterrupt

    outcome = flown(write_search(tmp_path), MadeUpEngine(before=interrupt))
    assert outcome.exit_code == 130


def test_a_search_without_a_failure_is_exit_0_and_without_proof_exit_3(tmp_path: Path) -> None:
    path = write_search(tmp_path)
    passed = flown(path, MadeUpEngine(verdict=lambda _: "PASS"))
    assert passed.exit_code == 0
    assert not passed.files
    assert not document(passed)["failures"]
    assert flown(path, MadeUpEngine(verdict=lambda _: "INVALID")).exit_code == 3
    assert flown(path, MadeUpEngine(is_broken=True)).exit_code == 3


def test_a_search_with_an_internal_error_says_so(tmp_path: Path) -> None:
    """Nothing but the exit code told it from a search that confirmed a failure."""
    path = write_search(tmp_path)
    outcome = flown(path, MadeUpEngine(is_broken=True))
    assert outcome.exit_code == 3
    assert document(outcome)["broken"] is True
    said = "an internal exception came up beside the flights"
    assert said in search_text(load_search(path), outcome)
    assert said in write_search_page(load_search(path), outcome).read_text()


def test_what_was_flown_is_shown_where_the_next_batch_is_refused(tmp_path: Path) -> None:
    """As by a vehicle that is switched off while a person brings it back."""
    path = write_search(tmp_path)

    def refuse(batch: int) -> None:
        if batch == 2:
            raise FlightRefusedError("real: no heartbeat", 3)

    with pytest.raises(FlightRefusedError):
        flown(path, MadeUpEngine(before=refuse))
    (written,) = tmp_path.glob("out/hover/search/*/search.json")
    found = json.loads(written.read_text())
    assert found["ended"] == "real: no heartbeat; continue with --resume"
    assert len(found["variants"]) == 2
    assert flown(path, MadeUpEngine(), resume=True).exit_code == 1


@pytest.mark.parametrize(("passes", "code"), [(1, 3), (2, 3), (3, 0)])
def test_a_search_that_proved_nothing_of_half_its_variants_is_3(
    tmp_path: Path, passes: int, code: int
) -> None:
    seen: list[float] = []

    def some(margin_m: float) -> Verdict:
        seen.append(margin_m)
        return "PASS" if len(seen) <= passes else "INVALID"

    path = write_search(tmp_path, TPE)
    outcome = flown(path, MadeUpEngine(verdict=some))
    assert (len(outcome.findings.tried), outcome.exit_code) == (4, code)
    said = search_text(load_search(path, ExpansionOptions()), outcome)
    assert f"{4 - passes} of 4 variants proved nothing (no PASS, no FAIL)" in said


@pytest.mark.parametrize(("proven", "code"), [(0, 3), (2, 3), (3, 0)])
def test_a_search_whose_dearest_mode_proved_nothing_of_half_its_variants_is_3(
    proven: int, code: int
) -> None:
    """All pass in simulation; of four in `wil` so many prove something."""
    flown = itertools.count(1)

    def answer(_: object, mode: str, __: int) -> float | None:
        return 1.0 if mode == "sim" or next(flown) <= proven else None

    given = problem(plane(), budget={"sim": 4, "wil": 4}, at_once=4)
    findings, _ = searched(given, answer, strategy="sobol")
    assert search_exit_code(findings, stopped=None, is_broken=False) == code
    assert unsettled_texts(findings) == [
        f"{4 - proven} of 4 variants proved nothing in wil (no PASS, no FAIL)"
    ]


@pytest.mark.parametrize("budget", [6, 40])
def test_variants_that_may_fail_in_the_dearest_mode_and_were_left_are_named(budget: int) -> None:
    """The six that were flown there pass, and by their gap the others may fail."""

    def answer(values: Values, mode: str, _: int) -> float:
        return 0.5 if mode == "sim" else 0.5 - 0.48 * abs(number(values, "y"))

    given = problem(plane(), budget={"sim": 40, "wil": budget}, at_once=3)
    findings, _ = searched(given, answer, strategy="sobol")
    assert search_exit_code(findings, stopped=None, is_broken=False) == 0
    said = "34 variants may fail in wil by the gap, and were not flown there: the budget is used up"
    assert unsettled_texts(findings) == ([said] if budget == 6 else [])


def test_variants_that_were_left_before_the_gap_was_measured_are_named() -> None:
    given = problem(plane(), budget={"sim": 40, "wil": 2})
    findings, _ = searched(given, lambda *_: 0.5, strategy="sobol")
    (said,) = unsettled_texts(findings)
    assert "38 variants may fail in wil as 2 pairs do not measure the gap, and were not" in said


def test_what_proved_nothing_is_not_counted_as_covered(tmp_path: Path) -> None:
    path = write_search(tmp_path)
    outcome = flown(path, MadeUpEngine(verdict=lambda m: "PASS" if m > -0.5 else "INVALID"))
    assert (len(outcome.findings.tried), outcome.exit_code) == (3, 0)
    covered = document(outcome)["coverage"]
    assert (covered["flown"], covered["cells"]) == (2, 3)
    search = load_search(path, ExpansionOptions())
    assert "coverage: 2 of 3 pairs of cells (67%)" in search_text(search, outcome)
    page = write_search_page(search, outcome).read_text()
    assert "2 of 3 admissible pairs of cells were flown" in page


def test_a_failure_that_is_neither_confirmed_nor_refuted_is_3(tmp_path: Path) -> None:
    seen: list[float] = []

    def once(margin_m: float) -> Any:
        seen.append(margin_m)
        is_first = len(seen) <= 3
        return ("FAIL" if margin_m < 0.0 else "PASS") if is_first else "ERROR"

    outcome = flown(write_search(tmp_path), MadeUpEngine(verdict=once))
    assert [one.standing for one in outcome.findings.cases] == ["undecided"]
    assert outcome.exit_code == 3


@pytest.mark.parametrize(
    ("fails", "code", "said"),
    [
        (2, 3, "failed again in 2 of 5 flights, too seldom to be confirmed and not refuted: it"),
        (0, 0, "failed, and not again in 5 flights: a rate of up to 0.52 is not excluded"),
    ],
)
def test_a_rate_is_printed_and_a_failure_that_comes_back_ends_with_3(
    tmp_path: Path, fails: int, code: int, said: str
) -> None:
    """Three variants are explored, and the one that fails is flown five times again."""
    seen: list[float] = []

    def seldom(margin_m: float) -> Verdict:
        seen.append(margin_m)
        return "FAIL" if margin_m < 0.0 and len(seen) <= 3 + fails else "PASS"

    search = SEARCH.replace("{flights: 2, most: 1}", "{flights: 5, at_least: 3, most: 3}")
    search = search.replace("from: 0.8, to: 2.0", "from: 0.8, to: 1.4")
    path = write_search(tmp_path, search)
    outcome = flown(path, MadeUpEngine(verdict=seldom))
    assert outcome.exit_code == code
    assert said in search_text(load_search(path, ExpansionOptions()), outcome)


def test_variants_are_overridden_after_the_settings_of_the_command_line(tmp_path: Path) -> None:
    search = SEARCH.replace("key: goal.altitude_m", "key: [goal.altitude_m, limits.speed_m_s]")
    path = write_search(tmp_path, search)
    outcome = flown(path, MadeUpEngine(), sets=("goal.altitude_m=1.25", "seed=7"))
    assert {one.variant.values["height"] for one in outcome.findings.tried} == {0.8, 1.4, 2.0}
    (name,) = outcome.files.values()
    campaign = load_campaign(outcome.folder / name)
    assert campaign.seed == 7
