"""The verdict on a case and mode in the table: PASS exactly if by itself it is accepted."""

from dataclasses import replace
from itertools import product

import pytest
from rich.text import Text

from tests.orchestrator.run_results.test_results import result
from wil_campaign.campaigns.statistics.sequential_test import SequentialTest
from wil_campaign.campaigns.values.acceptance import PassRequirement, PassShare
from wil_campaign.orchestrator.cli.verdict_table import verdict_table
from wil_campaign.orchestrator.run_results.acceptance_texts import row_verdict
from wil_campaign.orchestrator.run_results.attempts import attempt_of
from wil_campaign.orchestrator.run_results.campaign_results import summarize
from wil_campaign.orchestrator.run_results.exit_codes import exit_code, standings_of
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.safety.model.oracle_results import OracleResult

WORDS = {"P": "PASS", "F": "FAIL", "E": "ERROR", "I": "INVALID", "A": "ABORTED"}
TEST = SequentialTest(at_least=0.9, against=0.2, most=3)
ALL, TWO = (PassRequirement("large", "sim", PassShare(passes, 3)) for passes in (3, 2))
DECIDED = PassRequirement("large", "sim", PassShare(3, 3), TEST)


def runs_of(letters: str) -> list[RunResult]:
    """Return a run for each letter; X is a PASS with an internal exception."""
    return [
        result("PASS", rep, exceptions=("boom",)) if letter == "X" else result(WORDS[letter], rep)
        for rep, letter in enumerate(letters, 1)
    ]


def cell(
    runs: list[RunResult], wanted: PassRequirement, header: str = "verdict"
) -> tuple[str, str]:
    """Return text and style of the row in the table on the terminal."""
    summary = summarize(
        runs,
        [wanted],
        campaign="gate",
        clock="virtual",
        surrogate=False,
        real_kind="embedded",
        sensors={},
    )
    column = next(one for one in verdict_table(summary, [wanted]).columns if one.header == header)
    (found,) = column.cells
    shown = found if isinstance(found, Text) else Text(str(found))
    return shown.plain, str(shown.style)


def test_the_clearance_is_that_of_the_report_where_only_clearance_looked_so_far() -> None:
    far = OracleResult("clearance", "twin", True, "PASS", 2.6, 2.5, "m", 0.1, 3.0)
    none = OracleResult("collision_always", "twin", True, "PASS", None, 0.0, "m", None, None)
    runs = [replace(run, oracles=(none, far)) for run in runs_of("PPP")]
    assert cell(runs, ALL, "clearance\nm")[0] == "2.60"
    assert runs[0].clearance_m == 2.6


@pytest.mark.parametrize(
    ("letters", "wanted", "text", "style"),
    [
        ("PPF", TWO, "PASS (2/3)", "green"),
        ("PPE", TWO, "ERROR (2/3)", "bold magenta"),
        ("PFE", TWO, "ERROR (2/3)", "bold magenta"),
        ("PPX", TWO, "ERROR (2/3)", "bold magenta"),
        ("PP", TWO, "ERROR (2/3)", "bold magenta"),
        ("PFF", TWO, "FAIL (2/3)", "bold red"),
        ("FF", TWO, "FAIL (2/3)", "bold red"),
        ("PPP", ALL, "PASS", "green"),
        ("PP", ALL, "ERROR", "bold magenta"),
        ("PP", DECIDED, "PASS (0.9:0.2)", "green"),
        ("PIP", DECIDED, "INVALID (0.9:0.2)", "bold yellow"),
        ("FF", DECIDED, "FAIL (0.9:0.2)", "bold red"),
        ("PFP", DECIDED, "undecided (0.9:0.2)", "yellow"),
        ("P", DECIDED, "ERROR (0.9:0.2)", "bold magenta"),
    ],
)
def test_the_cell_of_a_row_has_verdict_count_and_colour(
    letters: str, wanted: PassRequirement, text: str, style: str
) -> None:
    assert cell(runs_of(letters), wanted) == (text, style)


def test_a_pass_that_was_flown_again_has_a_star() -> None:
    first, *rest = runs_of("PPF")
    again = replace(first, attempts=(attempt_of(result("INVALID"), "earlier/large/sim/1-1"),))
    assert cell([again, *rest], TWO) == ("PASS* (2/3), 2 attempts", "yellow")


@pytest.mark.parametrize("wanted", [ALL, TWO, DECIDED])
def test_a_row_is_pass_exactly_where_the_exit_code_is_0(wanted: PassRequirement) -> None:
    rows = [row for count in (1, 2, 3) for row in product("PFEIAX", repeat=count)]
    for letters in map("".join, rows):
        runs = runs_of(letters)
        (standing,) = standings_of(runs, [wanted])
        missing = 0 if standing.is_complete else 3 - len(runs)
        code = exit_code(runs, [wanted], missing=missing)
        word = row_verdict(standing, runs)
        assert (word == "PASS") == (code == 0), (letters, word, code)
        if code == 1:
            assert word in {"FAIL", "undecided"}, (letters, word)
