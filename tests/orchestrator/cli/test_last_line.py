"""The last line of a campaign is short; what does not fit stands above it, with what is next."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from rich.text import Text

from tests.orchestrator.run_results.test_results import result, summary
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.orchestrator.cli.progress_display import finished_line
from wil_campaign.orchestrator.cli.run_selection import RunSelection
from wil_campaign.orchestrator.cli.verdict_table import (
    LAST_LINE,
    conclusion_lines,
    explained_words,
    next_steps,
)
from wil_campaign.orchestrator.run_results.campaign_results import Summary
from wil_campaign.orchestrator.run_results.control_results import ControlResult
from wil_campaign.orchestrator.run_results.run_result import LaterEvent, RunResult
from wil_campaign.safety.model.oracle_results import OracleResult


def test_text_too_long_for_the_last_line_stands_above_it() -> None:
    left_out = tuple(f"a-long-name-of-a-case-{k}/wil" for k in range(6))
    found = replace(
        summary([result() for _ in range(3)]),
        left_out=left_out,
        not_flown=("small/wil/1",),
    )
    lines = [line.plain for line in conclusion_lines(found)]
    assert len(lines[-1]) <= LAST_LINE
    assert lines[-1].startswith(
        "accepted of what was flown; never flown: 1 of 4; required but left out"
    )
    assert lines[-2] == f"required but left out: {', '.join(left_out)}"


def test_of_very_many_runs_that_were_left_out_the_first_are_named() -> None:
    left_out = tuple(f"c{k}/wil" for k in range(4_000))
    lines = [line.plain for line in conclusion_lines(replace(summary([]), left_out=left_out))]
    assert any(line.endswith(", c10/wil, c11/wil and 3988 more") for line in lines)


def test_a_campaign_that_is_not_accepted_is_so_whatever_was_flown() -> None:
    found = replace(summary([result("FAIL")]), left_out=("large/wil",))
    last = conclusion_lines(found)[-1].plain
    assert last.startswith("not accepted; required but left out: large/wil")


def test_the_last_line_counts_very_many_parts() -> None:
    found = replace(
        summary([result("INVALID")]),
        unmet=tuple(f"the control number {k} ended as something else: why" for k in range(9)),
    )
    last = conclusion_lines(found)[-1].plain
    assert len(last) <= LAST_LINE
    assert "more above" in last


def test_a_short_last_line_has_all() -> None:
    found = replace(summary([result() for _ in range(3)]), left_out=("large/wil",))
    last = conclusion_lines(found)[-1].plain
    assert last.startswith("accepted of what was flown; required but left out: large/wil (the ")
    assert "above" not in last


def test_a_caveat_of_the_campaigns_file_is_counted_in_the_last_line() -> None:
    """The last line was a green "accepted", whatever the file leaves unjudged or unmixed."""
    text = "isolates 'wall' alone, and Wv in mode wil has nothing of it: nothing is mixed in"
    flown = summary([result() for _ in range(3)])
    *_, caveat, last = conclusion_lines(replace(flown, caveats=(text,), surrogate=False))
    assert (caveat.plain, last.plain) == (text, "accepted; 1 caveat")
    assert last.style == "yellow"


def test_a_reason_printed_while_flying_is_not_repeated() -> None:
    late = LaterEvent("INVALID", "mixing of camera: the mixture never showed gate", 9.0)
    failed = replace(result("FAIL"), reason="never flew through gate", also=(late,))
    line = finished_line(failed).plain
    doubt = "; the fault may not be the autonomy's: INVALID too, for mixing of camera: "
    assert f"never flew through gate{doubt}the mixture never showed gate" in line
    found = summary([failed])
    name = f"{failed.case}/{failed.mode}/{failed.rep}"
    again = [line.plain for line in conclusion_lines(found)]
    assert [doubt in line for line in again].count(True) == 1
    once = [line.plain for line in conclusion_lines(found, announced={name})]
    assert once == [line for line in again if "never flew" not in line]


def test_a_control_printed_while_flying_has_no_reason_beneath_the_table() -> None:
    control = replace(
        result("INVALID"),
        reason="the mixture never showed gate",
        control=ControlResult("large", "FAIL", "reached", None, met=False),
    )
    said = f"control {control.case} {control.mode} must FAIL by reached, but was INVALID"
    found = replace(summary([result()]), controls=(control,), unmet=(f"{said} ({control.reason})",))
    name = f"{control.case}/{control.mode}/{control.rep}"
    lines = [line.plain for line in conclusion_lines(found, announced={name})]
    assert not any(control.reason in line for line in lines)
    assert f"not accepted; {said} (the" in lines[-1]


def test_words_are_explained_where_they_stand() -> None:
    plain = summary([result()])
    assert [line.plain for line in explained_words(plain)] == []
    some = replace(
        plain,
        runs=(replace(result("INVALID"), required=False),),
        left_out=("large/wil",),
    )
    words = [line.plain.partition(":")[0] for line in explained_words(some)]
    assert words == ["reported", "INVALID", "left out"]


def failed_by(*names: str) -> RunResult:
    """Return a run that FAILed by these oracles of its twin; the first one decided."""
    oracles = tuple(
        OracleResult(name, "twin", True, "FAIL", 2.0, 1.0, "m", -1.0, 5.0) for name in names
    )
    return replace(result("FAIL"), oracles=oracles, decided_by=f"{names[0]}/twin")


def steps_after(
    flown: Summary,
    folder: Path,
    words: Sequence[str] = ("my gate.yaml",),
    clock: Clock | None = None,
    *,
    has_report: bool = False,
) -> list[Text]:
    return next_steps(flown, flown=words, clock=clock, folder=folder, has_report=has_report)


@pytest.mark.parametrize(
    ("names", "offered"),
    [
        (("clearance",), True),
        (("near", "geofence"), True),  # a formula of the campaign's own name
        (("touchdown_always",), True),
        (("collision",), False),
        (("collision_always",), False),
        (("time_limit", "reached"), False),
        (("landed",), False),
    ],
)
def test_judging_again_is_offered_where_other_limits_can_help(
    names: tuple[str, ...], offered: bool
) -> None:
    some = replace(summary([failed_by(*names)]), broken=False)
    lines = steps_after(some, folder=Path("1"))
    assert [" judge " in line.plain for line in lines] == [True] * offered


def test_the_next_steps_are_those_of_the_outcome() -> None:
    folder = Path("results/gate/1")
    accepted = replace(summary([result()]), broken=False)
    (only,) = steps_after(accepted, folder, has_report=True)
    assert "open the report" in only.plain
    slow = failed_by("time_limit")
    failed = replace(summary([slow]), broken=False, stopped="signal")
    lines = [line.plain for line in steps_after(failed, folder)]
    assert lines == [
        "next: wil-campaign run 'my gate.yaml' --out results/gate/1 --resume flies what is missing",
        "next: wil-campaign judge 'my gate.yaml' results/gate/1 tries other limits without flying",
    ]
    words = ("g.yaml", *RunSelection(case=("a*",), repetitions=1, set_=("seed=5",)).words)
    lines = [line.plain for line in steps_after(failed, folder, words, "wall")]
    chosen = "--case 'a*' --repetitions 1 --set seed=5"
    again = f"run g.yaml {chosen} --clock wall --out results/gate/1 --resume"
    assert [f"wil-campaign {again} " in lines[0], f"/1 {chosen} tries" in lines[1]] == [True, True]
    grounded = replace(summary([replace(slow, decided_by="guard.fence/twin")]), broken=False)
    assert steps_after(grounded, folder) == []
    excepted = replace(summary([result()]), broken=True)
    (anew,) = steps_after(excepted, folder, ("g.yaml",), "wall")
    assert anew.plain == (
        "next: wil-campaign run g.yaml --clock wall flies the campaign anew: after an internal"
        " exception no --resume is accepted"
    )
    log = "large/sim/1/twin-node.log"
    dead = replace(result("FAIL"), decided_by="autonomy/twin", artifacts=(log,))
    ended = replace(summary([dead]), broken=False)
    (pointed,) = steps_after(ended, folder)
    assert pointed.plain == f"next: results/gate/1/{log} has all that the autonomy printed"
