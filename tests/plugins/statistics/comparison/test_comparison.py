"""compare: worse beyond chance and size, and what cannot be compared."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.reading.flown_campaign import (
    Flight,
    flights,
    write_control,
    write_flown,
    write_searched,
    write_summary_anew,
)
from tests.orchestrator.run_results.test_flown_firmware import BOARD
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.run_results.control_results import ControlResult
from wil_campaign.orchestrator.run_results.run_result import EarlierAttempt, RunResult
from wil_campaign.plugins.statistics.comparison.comparison import (
    FlightComparison,
    LossLimits,
    compare_flown_sets,
    runs_by_cell,
)

Capture = pytest.CaptureFixture[str]
TEN = tuple(n / 100 for n in range(10))
CHANGED = (("P", "before"), ("F", "after"))


def compared(before: list[Flight], after: list[Flight], **limits: float) -> FlightComparison:
    old, new = (runs_by_cell(one.result() for one in given) for given in (before, after))
    return compare_flown_sets(old, new, LossLimits(**limits))


def test_a_large_loss_is_worse_and_a_small_one_may_be_chance() -> None:
    before = flights("a", "wil", "P" * 10, TEN)
    found = compared(before, flights("a", "wil", "FFFFFFPPPP", TEN))
    (change,) = found.changes
    assert change.p == pytest.approx(0.0054, abs=1e-4)
    assert (change.before, change.after, change.outcome) == (1.0, 0.4, "worse")
    (change,) = compared(before, flights("a", "wil", "FPPPPPPPPP", TEN)).changes
    assert change.p == 0.5
    assert change.outcome == "undecided"
    assert compared(before, before).worse == ()


def test_a_loss_below_the_size_is_not_worse() -> None:
    many = tuple(n / 1000 for n in range(100))
    before, after = (
        flights("a", "wil", "P" * 100, many),
        flights("a", "wil", "F" * 9 + "P" * 91, many),
    )
    (small,) = compared(before, after, pass_rate=0.1).changes
    assert small.p is not None
    assert small.p < 0.01
    assert small.outcome == "not worse"
    (large,) = compared(before, after, pass_rate=0.05).changes
    assert large.outcome == "worse"


def test_a_margin_that_shrinks_is_worse_although_all_pass() -> None:
    before = flights("a", "wil", "P" * 10, TEN)
    after = flights("a", "wil", "P" * 10, [0.15 + each for each in TEN])
    assert compared(before, after).worse == ()
    (worse,) = compared(before, after, margin=0.1).worse
    assert worse.what == "margin of collision"
    assert worse.loss == pytest.approx(0.15)
    assert compared(before, after, margin=0.2).worse == ()


def near(cell: str, margins_m: Sequence[float | None]) -> list[Flight]:
    """Return a passed flight for each margin; None where nothing came near."""
    spread = [each / 1000 for each in range(len(margins_m))]
    plain = flights(cell, "wil", "P" * len(margins_m), spread)
    return [replace(one, margin_m=each) for one, each in zip(plain, margins_m, strict=True)]


def test_near_contact_is_worse_than_nothing_near() -> None:
    apart, close = near("a", [None] * 10), near("a", [0.15] * 10)
    (worse,) = compared(apart, close, margin=0.5).worse
    assert (worse.what, worse.before, worse.after) == ("margin of collision", 2.0, 0.15)
    assert worse.is_beyond == (True, False)
    assert worse.loss == pytest.approx(1.85)
    assert compared(close, apart, margin=0.5).worse == ()
    assert [one.what for one in compared(apart, apart, margin=0.5).changes] == ["pass rate"]


def test_fewer_flights_with_nothing_near_may_be_chance() -> None:
    (_, one_of_ten) = compared(
        near("a", [None] * 10), near("a", [0.5, *[None] * 9]), margin=0.1
    ).changes
    assert one_of_ten.outcome == "undecided"
    assert (one_of_ten.is_beyond, one_of_ten.flights) == ((True, True), (10, 10))
    (_, half) = compared(near("a", [0.5, None]), near("a", [0.5, 0.6, None]), margin=0.1).changes
    assert half.is_beyond == (True, True)
    assert half.before == pytest.approx(1.25)
    assert half.after == pytest.approx(3.1 / 3)


def test_what_stands_before_and_after_is_what_was_compared() -> None:
    before, after = [0.5, 0.5, 0.5, 0.6, 0.6], [0.1, 0.1, 0.5, 0.6, 0.6]
    (_, change) = compared(near("a", before), near("a", after), margin=0.1).changes
    assert [change.before, change.after] == pytest.approx([0.54, 0.38])
    assert change.loss == pytest.approx(change.before - change.after)


def test_a_margin_that_no_limit_gives_is_not_taken_for_nothing_near() -> None:
    """An oracle without a limit measures and has no margin: it was not beyond one."""

    def unlimited(one: Flight) -> RunResult:
        plain = one.result()
        (oracle,) = plain.oracles
        return replace(plain, oracles=(replace(oracle, limit=None, margin=None),))

    now = near("a", [0.15] * 10)
    old, new = runs_by_cell(map(unlimited, now)), runs_by_cell(one.result() for one in now)
    (rate,) = compare_flown_sets(old, new, LossLimits(margin=0.1)).changes
    assert rate.what == "pass rate"


def test_the_table_shows_that_nothing_came_near(tmp_path: Path, capsys: Capture) -> None:
    old = write_flown(tmp_path / "old", near("a", [None] * 10), with_motion=False)
    new = write_flown(tmp_path / "new", near("a", [0.15] * 10), with_motion=False)
    assert main(["compare", str(old), str(new), "--margin-by", "0.5"]) == 1
    (row,) = (line for line in capsys.readouterr().out.splitlines() if "of collision " in line)
    assert "margin of collision  > 2 m   0.15 m  10 and 10" in row
    assert main(["compare", str(new), str(old), "--margin-by", "0.5", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["changes"][1]["is_beyond"] == [False, True]


def test_more_tests_make_chance_harder_to_exclude() -> None:
    before = [*flights("a", "wil", "PPPPP", TEN[:5]), *flights("b", "wil", "PPPPP", TEN[:5])]
    after = [*flights("a", "wil", "FFFFP", TEN[:5]), *flights("b", "wil", "PPPPP", TEN[:5])]
    alone = compared(before[:5], after[:5])
    assert [one.outcome for one in alone.changes] == ["worse"]
    assert [one.p for one in alone.changes] == [pytest.approx(0.0238, abs=1e-4)]
    together = compared(before, after)
    assert [one.p for one in together.changes] == [pytest.approx(0.0476, abs=1e-4), 1.0]


def test_equal_margins_of_unequal_numbers_of_flights_do_not_differ() -> None:
    found = compared(flights("a", "sim", "PPP"), flights("a", "sim", "PPPPP"), margin=0.1)
    assert [(one.what, one.p) for one in found.changes] == [
        ("pass rate", 1.0),
        ("margin of collision", 1.0),
    ]


def test_equal_runs_that_differ_are_no_chance() -> None:
    found = compared(flights("a", "sim", "PPP"), flights("a", "sim", "FFF"))
    assert [(one.p, one.outcome) for one in found.changes] == [(0.0, "worse")]
    assert found.flips[0] == "a/sim/1: PASS before, FAIL now"
    mixed = compared(flights("a", "sim", "PPP"), flights("a", "sim", "FFF", TEN[:3]))
    (change,) = mixed.changes
    assert (change.p, change.outcome) == (None, "undecided")
    assert change.why.startswith("the flights before are equal")


@pytest.mark.parametrize("equal", ["before", "after"])
def test_a_loss_that_no_test_can_decide_is_not_as_good_as_before(
    tmp_path: Path, capsys: Capture, equal: str
) -> None:
    """20 of 20 and then 0 of 20 was exit code 0, and the remedy to fly more."""
    spread = {"before": TEN * 2, "after": TEN * 2, equal: ()}
    passed, failed = (flights("a", "sim", word * 20, spread[at]) for word, at in CHANGED)
    old = write_flown(tmp_path / "old", passed, with_motion=False)
    new = write_flown(tmp_path / "new", failed, with_motion=False)
    assert main(["compare", str(old), str(new)]) == 3
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.endswith("1 lost more than the limit and cannot be tested: equal flights")
    assert "fly more" not in last
    assert main(["compare", str(new), str(old)]) == 0, "a gain is no loss"
    other = write_flown(
        tmp_path / "other", [*failed, *flights("b", "sim", "F" * 9, TEN[:9])], with_motion=False
    )
    both = write_flown(
        tmp_path / "both", [*passed, *flights("b", "sim", "P" * 9, TEN[:9])], with_motion=False
    )
    assert main(["compare", str(both), str(other)]) == 1, "what is worse is worse"


@pytest.mark.parametrize(
    ("before", "after", "code"),
    [("P", "F", 3), ("PP", "FF", 3), ("PPP", "FFF", 1), ("PPPP", "PFFF", 0), ("PP", "PP", 0)],
)
def test_so_few_flights_that_no_loss_is_beyond_chance_are_no_good_comparison(
    before: str, after: str, code: int, tmp_path: Path, capsys: Capture
) -> None:
    """One PASS before and one FAIL now: "undecided", exit code 0, and a release went out."""
    folders = []
    for name, verdicts in (("before", before), ("after", after)):
        spread = [len(name) / 100 + n / 100 for n in range(len(verdicts))]
        folders.append(tmp_path / name)
        write_flown(folders[-1], flights("a", "wil", verdicts, spread))
    assert main(["compare", *map(str, folders)]) == code
    out = capsys.readouterr().out
    assert ("so few flights decide no loss" in out) == (code == 3)
    assert ("cannot be tested: too few flights" in out) == (code == 3)


def test_a_p_at_the_level_is_beyond_chance_and_one_beside_it_is_not_rounded_to_it(
    tmp_path: Path, capsys: Capture
) -> None:
    def shown(was: str, now: str, confidence: str) -> tuple[int, list[str]]:
        place = tmp_path / f"{was}{now}{confidence}"
        old, new = (
            write_flown(
                place / name,
                flights("a", "wil", verdicts, [n / 1000 for n in range(len(verdicts))]),
                with_motion=False,
            )
            for name, verdicts in (("old", was), ("new", now))
        )
        code = main(["compare", str(old), str(new), "--confidence", confidence])
        (row,) = (line for line in capsys.readouterr().out.splitlines() if line[:2] == "a ")
        return code, row.split()[-2:]

    # One of 20 ways, and one of 10: 1 - 0.9 is a little below 0.1.
    assert shown("PPP", "FFF", "0.95") == (1, ["0.05", "worse"])
    assert shown("PPP", "FF", "0.9") == (1, ["0.1", "worse"])
    assert shown("P" * 6 + "F" * 6, "F" * 6, "0.95") == (1, ["0.0498", "worse"])
    assert shown("P" * 17, "P" * 8 + "FFF", "0.95") == (0, ["0.0504", "undecided"])


def test_flights_that_prove_nothing_any_more_do_not_leave_the_rest_as_good_as_before(
    tmp_path: Path, capsys: Capture
) -> None:
    spoilt = [*flights("a", "wil", "PIIII", TEN[:5]), *flights("b", "wil", "PP", TEN[:2])]
    sound = [*flights("a", "wil", "PPPPP", TEN[:5]), *flights("b", "wil", "PP", TEN[:2])]
    said = "a/wil: 4 of 5 flights, 0 of 5 before"
    assert compared(sound, spoilt).fewer_proven == (said,)
    assert compared(spoilt, sound).fewer_proven == ()
    assert compared(spoilt, spoilt).fewer_proven == (), "no more than before"
    old = write_flown(tmp_path / "old", sound, with_motion=False)
    new = write_flown(tmp_path / "new", spoilt, with_motion=False)
    assert main(["compare", str(old), str(new)]) == 3
    assert f"more flights that prove nothing: {said}" in capsys.readouterr().out
    assert main(["compare", str(new), str(old)]) == 0


def test_runs_that_pass_only_when_flown_again_are_named() -> None:
    passed = runs_by_cell(one.result() for one in flights("a", "wil", "PP", TEN[:2]))
    attempts = tuple(EarlierAttempt(one, "no", "") for one in ("INVALID", "ERROR", "ABORTED", None))
    again = {
        cell: [replace(run, attempts=attempts) for run in runs] for cell, runs in passed.items()
    }
    found = compare_flown_sets(passed, again, LossLimits())
    assert found.flown_again == ("a/wil: 4 beside 2 flights, 0 beside 2 before",)
    assert compare_flown_sets(again, again, LossLimits()).flown_again == ()
    assert compare_flown_sets(again, passed, LossLimits()).flown_again == ()


def test_the_command_exits_1_when_a_case_became_worse(tmp_path: Path, capsys: Capture) -> None:
    old = write_flown(tmp_path / "old", flights("a", "wil", "P" * 10, TEN), with_motion=False)
    bad = write_flown(
        tmp_path / "bad", flights("a", "wil", "F" * 6 + "PPPP", TEN), with_motion=False
    )
    assert main(["compare", str(old), str(bad)]) == 1
    text = capsys.readouterr().out
    changed = "6 of 10 runs of equal seed changed the verdict"
    assert text.splitlines()[-1] == f"{changed}; worse: a/wil pass rate"
    assert "same seed, other verdict: a/wil/1: PASS before, FAIL now" in text
    assert main(["compare", str(old), str(bad), "--worse-by", "0.7"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith(f"{changed}; nothing became worse beyond chance and size")
    assert main(["compare", str(old), str(old)]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.endswith("chance and size; 10 runs of equal seed kept the verdict")
    assert main(["compare", str(bad), str(old), "--json"]) == 0
    last = capsys.readouterr().out
    assert json.loads(last[last.index('{\n  "schema"') :])["changes"][0]["outcome"] == "not worse"


def test_the_page_shows_intervals_changed_settings_and_links(tmp_path: Path) -> None:
    limits = [{"oracles": {"altitude": {"max_m": max_m}}} for max_m in (2.3, "<b>9")]
    old = write_flown(
        tmp_path / "old", flights("a", "wil", "P" * 10, TEN), document=limits[0], with_motion=False
    )
    bad = write_flown(
        tmp_path / "b d",
        flights("a", "wil", "F" * 6 + "PPPP", TEN),
        document=limits[1],
        with_motion=False,
    )
    (bad / "report.html").write_text("<!doctype html>")
    page = tmp_path / "compare.html"
    assert main(["compare", str(old), str(bad), "--changed", "--page", str(page)]) == 1
    text = page.read_text()
    assert "worse: a/wil pass rate" in text
    assert "10 of 10 passed, interval of 69% to 100%" in text
    assert "4 of 10 passed, interval of 12% to 74%" in text
    assert text.count('class="interval"') == 2
    assert 'href="b%20d/report.html"' in text
    assert "old/report.html" not in text, "there is none"
    assert "<b>changed</b> <bdi>oracles.altitude.max_m was 2.3, now it is" in text
    assert "<b>9" not in text
    missing = tmp_path / "none" / "page.html"
    assert main(["compare", str(old), str(bad), "--page", str(missing)]) == 3


def test_a_comment_says_that_a_comparison_proves_nothing_and_why(
    tmp_path: Path, capsys: Capture
) -> None:
    """Its heading was "nothing became worse", and the reasons were on standard error alone."""
    flown = flights("a", "wil", "PPP", TEN[:3])
    old = write_flown(tmp_path / "old", flown, with_motion=False)
    new = write_flown(tmp_path / "new", flown, with_motion=False, stopped="signal")
    page = tmp_path / "compare.html"
    assert main(["compare", str(old), str(new), "--markdown", "--page", str(page)]) == 3
    comment = capsys.readouterr().out
    assert comment.startswith("### this comparison proves nothing; nothing became worse")
    assert "new: stopped by Ctrl-C or SIGTERM" in comment
    assert "this comparison proves nothing; nothing became worse" in page.read_text()
    assert "stopped by Ctrl-C or SIGTERM" in page.read_text()
    assert main(["compare", str(old), str(new), "--json"]) == 3
    (problem,) = json.loads(capsys.readouterr().out)["problems"]
    assert problem.endswith("new: stopped by Ctrl-C or SIGTERM")
    assert main(["compare", str(old), str(old), "--markdown"]) == 0
    assert "proves nothing" not in capsys.readouterr().out


def test_a_case_that_is_not_flown_any_more_is_no_good_comparison(
    tmp_path: Path, capsys: Capture
) -> None:
    one, two = flights("a", "wil", "PPP", TEN[:3]), flights("b", "wil", "PPP", TEN[:3])
    both = write_flown(tmp_path / "both", [*one, *two], with_motion=False)
    fewer = write_flown(tmp_path / "fewer", one, with_motion=False)
    assert main(["compare", str(both), str(fewer)]) == 3
    outcome = capsys.readouterr()
    assert "not flown any more: b/wil" in outcome.out
    assert "give --removed if that is intended" in outcome.err
    assert main(["compare", str(both), str(fewer), "--removed"]) == 0
    assert "not flown any more: b/wil" in capsys.readouterr().out
    assert main(["compare", str(fewer), str(both)]) == 0, "more is no less"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("remove", "not judged any more: a/wil: collision of real\n"),
        ("report", "not judged any more: a/wil: collision of real is only reported now\n"),
    ],
)
def test_an_oracle_that_is_gone_is_no_good_comparison(
    tmp_path: Path, capsys: Capture, change: str, said: str
) -> None:
    flown = flights("a", "wil", "PPP", TEN[:3])
    old = write_flown(tmp_path / "old", flown, with_motion=False)
    new = write_flown(tmp_path / "new", flown, with_motion=False)
    for path in new.glob("a/wil/*/result.json"):
        document = json.loads(path.read_text())
        if change == "remove":
            document["oracles"] = []
        else:
            document["oracles"][0]["required"] = False
        path.write_text(json.dumps(document))
    write_summary_anew(new)
    assert main(["compare", str(old), str(new)]) == 3
    assert said in capsys.readouterr().out
    assert main(["compare", str(old), str(new), "--removed"]) == 0
    assert said in capsys.readouterr().out
    assert main(["compare", str(new), str(old)]) == 0, "more is no less"


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"stopped": "signal"}, "stopped by Ctrl-C or SIGTERM"),
        ({"stopped": "command"}, "stopped by an operator's command"),
        ({"broken": True}, "an internal exception occurred outside of its runs"),
        ({"broken": None}, "summary.json does not record the end of the campaign"),
    ],
)
def test_the_end_of_a_campaign_outside_of_its_runs_is_named(
    tmp_path: Path, capsys: Capture, how: dict[str, Any], said: str
) -> None:
    flown = flights("a", "wil", "P" * 5, TEN[:5])
    sound = write_flown(tmp_path / "sound", flown, with_motion=False)
    ended = write_flown(tmp_path / "ended", flown, with_motion=False, **how)
    assert main(["compare", str(sound), str(ended)]) == 3
    assert f"{ended}: {said}" in capsys.readouterr().err
    assert main(["compare", str(ended), str(sound)]) == 0, "the judged one came to its end"
    assert f"{ended}: {said}" in capsys.readouterr().err


def test_a_campaign_that_cannot_fail_is_no_good_comparison(tmp_path: Path, capsys: Capture) -> None:
    flown = flights("a", "wil", "P" * 5, TEN[:5])
    sound = write_flown(tmp_path / "sound", flown, with_motion=False)
    green = write_flown(tmp_path / "green", flown, with_motion=False)
    for folder, verdict in ((sound, "FAIL"), (green, "PASS")):
        (control,) = flights("blind", "wil", verdict[0])
        met = ControlResult("a", "FAIL", None, None, met=verdict == "FAIL")
        write_control(folder, replace(control.result(), required=False, control=met))
    assert main(["compare", str(sound), str(green)]) == 3
    said = f"{green}: this campaign cannot fail: control blind in mode wil passed"
    assert said in capsys.readouterr().err
    assert main(["compare", str(green), str(sound)]) == 0, "the controls of the judged one failed"
    assert said in capsys.readouterr().err


def test_a_summary_of_an_earlier_version_is_not_taken_for_a_whole_campaign(
    tmp_path: Path, capsys: Capture
) -> None:
    flown = flights("a", "wil", "P" * 5, TEN[:5])
    old = write_flown(tmp_path / "old", flown, with_motion=False)
    document = json.loads((old / "summary.json").read_text())
    del document["stopped"], document["broken"]
    (old / "summary.json").write_text(json.dumps(document))
    assert main(["compare", str(old), str(old)]) == 3
    assert "flown by an earlier version" in capsys.readouterr().err


def test_the_baseline_is_the_last_campaigns_before(tmp_path: Path, capsys: Capture) -> None:
    for day, verdicts in ((1, "FFFFF"), (2, "PPPPP"), (3, "PPPPP"), (5, "FFFFF")):
        write_flown(
            tmp_path / f"results/2026110{day}",
            flights("a", "wil", verdicts, [each + day / 50 for each in TEN[:5]]),
            started_utc=f"2026-11-0{day}T10:00:00Z",
            with_motion=False,
        )
    now = write_flown(
        tmp_path / "results/20261104",
        flights("a", "wil", "FFFFP", TEN[:5]),
        started_utc="2026-11-04T10:00:00Z",
        with_motion=False,
    )
    command = ["compare", str(tmp_path / "results"), str(now)]
    assert main([*command, "--last", "2"]) == 1
    text = capsys.readouterr().out
    assert text.startswith("20261104 against 20261102, 20261103\n")
    assert "10 and 5" in text
    assert main([*command, "--last", "3"]) == 0
    assert "15 and 5" in capsys.readouterr().out


def test_the_baseline_has_neither_searches_nor_other_campaigns(
    tmp_path: Path, capsys: Capture
) -> None:
    results = tmp_path / "results"
    for day, name in ((1, "gate"), (2, "gate"), (3, "box")):
        write_flown(
            results / f"{name}/2026110{day}",
            flights("a", "wil", "PP", (day / 50, day / 40)),
            name=name,
            started_utc=f"2026-11-0{day}T10:00:00Z",
            with_motion=False,
        )
    write_searched(results / "gate", started_utc="2026-11-04T10:00:00Z")
    now = write_flown(tmp_path / "now", flights("a", "wil", "PP", TEN[:2]), with_motion=False)
    for folder in (results, results / "gate"):
        assert main(["compare", str(folder), str(now), "--last", "2"]) == 0
        outcome = capsys.readouterr()
        assert outcome.out.startswith("now against 20261101, 20261102\n")
        assert outcome.err == ""


def test_a_repeated_flight_counts_once(tmp_path: Path, capsys: Capture) -> None:
    for day in range(1, 6):
        write_flown(
            tmp_path / f"results/2026110{day}",
            flights("a", "wil", "PPPPP", TEN[:5]),
            started_utc=f"2026-11-0{day}T10:00:00Z",
            with_motion=False,
        )
    now = write_flown(tmp_path / "now", flights("a", "wil", "FFPPP", TEN[:5]), with_motion=False)
    command = ["compare", str(tmp_path / "results"), str(now)]
    assert main(command) == 0
    (row,) = (line for line in capsys.readouterr().out.splitlines() if line[:2] == "a ")
    assert row.split()[-5:] == ["5", "and", "5", "0.22", "undecided"]
    assert main([*command, "--margin-by", "0.001"]) == 0
    assert capsys.readouterr().out.count(" 5 and 5 ") == 2, "margins too"


def test_flights_of_other_seeds_are_no_repeats() -> None:
    one = flights("a", "wil", "PPPPP", TEN[:5])
    other = [replace(each, seed=200 + each.rep) for each in one]
    (change,) = compared([*one, *other], flights("a", "wil", "PPPPP", TEN[:5])).changes
    assert change.flights == (10, 5)


def test_repeats_of_one_flight_are_equal_runs() -> None:
    one = flights("a", "sim", "P")
    (change,) = compared([*one, *one], flights("a", "sim", "FF")).changes
    assert (change.flights, change.p, change.outcome) == ((1, 2), 0.0, "worse")


@pytest.mark.parametrize(
    ("kind", "code", "words"),
    [
        ("missing", 2, "does not exist"),
        ("file", 2, "is a file"),
        ("empty", 2, "is not the results folder"),
        ("nothing shared", 2, "the campaigns have no case and mode in common: b/wil; and a/wil"),
        ("other version", 3, "a/wil/1: result.json is truncated, damaged or of another version"),
        ("unproven", 3, ""),
        ("nothing before", 2, "contains no campaign 'gate' that was flown before"),
        ("another campaign", 2, "contains no campaign 'gate' that was flown before"),
    ],
)
def test_folders_that_cannot_be_compared_are_refused(
    tmp_path: Path, capsys: Capture, kind: str, code: int, words: str
) -> None:
    now = write_flown(tmp_path / "now", flights("a", "wil", "PP", TEN[:2]), with_motion=False)
    other = tmp_path / "other"
    if kind == "file":
        other.write_text("")
    elif kind == "empty":
        other.mkdir()
    elif kind == "nothing shared":
        write_flown(other, flights("b", "wil", "PP", TEN[:2]), with_motion=False)
    elif kind == "other version":
        write_flown(other, flights("a", "wil", "PP", TEN[:2]), with_motion=False)
        path = other / "a/wil/1/result.json"
        path.write_text(path.read_text().replace('"verdict": "PASS"', '"verdict": "GREEN"', 1))
    elif kind == "unproven":
        write_flown(other, flights("a", "wil", "II", TEN[:2]), with_motion=False)
    elif kind == "nothing before":
        write_flown(other / "x", flights("a", "wil", "PP"), started_utc="2027", with_motion=False)
    elif kind == "another campaign":
        flown = flights("a", "wil", "PP")
        write_flown(other / "x", flown, name="box", started_utc="2025", with_motion=False)
    assert main(["compare", str(other), str(now)]) == code
    outcome = capsys.readouterr()
    assert words in outcome.err
    assert "Traceback" not in outcome.err


GATE: dict[str, Any] = {
    "campaign": "gate",
    "description": "as it was",
    "oracles": {"altitude": {"max_m": 2.3}, "collision": {}},
    "cases": {"a": {}},
    "controls": {"blind": {"expect": {"verdict": "FAIL"}}},
    "autonomy": {"use": "gate.py:Gate", "with": {"speed_m_s": 0.8}},
    "repetitions": 5,
}
FILES = {"gate.yaml": "a", "../worlds/gate.yaml": "b", "gate.py": "c"}


def flown_as(folder: Path, **manifest: Any) -> Path:
    """Write ten passes; manifest: what differs from GATE and FILES."""
    write_flown(folder, flights("a", "wil", "P" * 10, TEN), with_motion=False)
    path = folder / "campaign.json"
    plugins = {"sonar": "wil-sonar 1.2"}
    plain = {"file": "gate.yaml", "document": GATE, "files": FILES, "plugins": plugins}
    path.write_text(json.dumps({**json.loads(path.read_text()), **plain, **manifest}))
    return folder


def test_a_folder_counts_once_whatever_leads_to_it(tmp_path: Path, capsys: Capture) -> None:
    for day in (1, 2):
        flown_as(tmp_path / f"before/{day}", started_utc=f"2026-11-0{day}T10:00:00Z")
    (tmp_path / "before/latest").symlink_to("2")
    now = flown_as(tmp_path / "now")
    assert main(["compare", str(tmp_path / "before"), str(now), "--last", "2"]) == 0
    assert capsys.readouterr().out.startswith("now against 1, 2\n")


def test_folders_of_one_name_are_compared_each_for_itself(tmp_path: Path, capsys: Capture) -> None:
    """As those of two jobs of CI, or of two machines that started in the same second."""
    other = {**GATE, "oracles": {"altitude": {"max_m": 5}, "collision": {}}}
    flown_as(tmp_path / "before/one/gate", document=other, started_utc="2026-11-01T10:00:00Z")
    flown_as(tmp_path / "before/two/gate", started_utc="2026-11-02T10:00:00Z")
    now = flown_as(tmp_path / "now")
    assert main(["compare", str(tmp_path / "before"), str(now)]) == 3
    place = tmp_path / "before/one/gate"
    assert f"other settings: {place}: oracles.altitude.max_m was 5" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("manifest", "option", "said"),
    [
        (
            {"document": {**GATE, "oracles": {"altitude": {"max_m": 5}, "collision": {}}}},
            "--changed",
            "other settings: oracles.altitude.max_m was 2.3, now it is 5\n",
        ),
        (
            {"document": {**GATE, "oracles": {**GATE["oracles"], "collision": {"exclude": ["a"]}}}},
            "--changed",
            'other settings: oracles.collision.exclude was null, now it is ["a"]\n',
        ),
        (
            {"document": {**GATE, "controls": {}}},
            "--removed",
            'not set any more: controls.blind was {"expect": {"verdict": "FAIL"}}, now it is null',
        ),
        (
            {"files": {**FILES, "../worlds/gate.yaml": "other"}},
            "--changed",
            "other settings: ../worlds/gate.yaml changed\n",
        ),
        (
            {"files": {name: FILES[name] for name in ("gate.yaml", "gate.py")}},
            "--changed",
            "other settings: ../worlds/gate.yaml is not read any more\n",
        ),
        (
            {"options": {"set": ["world.objects.gate.shape.gate.inner_size_m=2"]}},
            "--changed",
            "other settings: --set world.objects.gate.shape.gate.inner_size_m=2 was not given\n",
        ),
        (
            {"document": {**GATE, "cases": {"a": {"oracles.altitude": None}}}},
            "--removed",
            "not set any more: cases.a.oracles.altitude was not set, now it is null\n",
        ),
        (
            {"document": {**GATE, "autonomy": {**GATE["autonomy"], "limits": {"call_s": 99}}}},
            "--changed",
            'other settings: autonomy.limits was null, now it is {"call_s": 99}\n',
        ),
        ({"clock": "scaled"}, "--changed", "other settings: the clock was virtual, now it is sca"),
    ],
)
def test_flights_by_other_settings_are_no_good_comparison(
    tmp_path: Path, capsys: Capture, manifest: dict[str, Any], option: str, said: str
) -> None:
    """All pass before and after: by weaker limits, without a control, in another world."""
    old, new = flown_as(tmp_path / "old"), flown_as(tmp_path / "new", **manifest)
    assert main(["compare", str(old), str(new)]) == 3
    printed = capsys.readouterr()
    assert said in printed.out
    assert f"give {option} if that is intended" in printed.err
    assert main(["compare", str(old), str(new), option]) == 0
    assert said in capsys.readouterr().out, "it is named all the same"
    assert main(["compare", str(old), str(new), "--json"]) == 3
    settings = json.loads(capsys.readouterr().out)["settings"]
    assert len(settings["removed"] + settings["changed"]) == 1


@pytest.mark.parametrize(
    ("manifest", "said"),
    [
        (
            {"document": {**GATE, "autonomy": {"use": "gate.py:Gate", "with": {"speed_m_s": 1}}}},
            "also changed: autonomy.with.speed_m_s was 0.8, now it is 1\n",
        ),
        ({"files": {**FILES, "gate.py": "other"}}, "also changed: gate.py changed\n"),
        (
            {"document": {**GATE, "oracles": {**GATE["oracles"], "link": {"max_gap_s": 1}}}},
            'also changed: oracles.link was null, now it is {"max_gap_s": 1}\n',
        ),
        ({"versions": {"wil-campaign": "2"}}, "also changed: wil-campaign was "),
        (
            {"plugins": {"sonar": "wil-sonar 1.3"}},
            "also changed: the plugin sonar was wil-sonar 1.2, now it is wil-sonar 1.3\n",
        ),
        (
            {
                "document": {**GATE, "description": "another text", "repetitions": 10},
                "files": {**FILES, "gate.yaml": "other"},
            },
            "",
        ),
    ],
)
def test_campaigns_of_different_subjects_may_be_compared(
    tmp_path: Path, capsys: Capture, manifest: dict[str, Any], said: str
) -> None:
    old, new = flown_as(tmp_path / "old"), flown_as(tmp_path / "new", **manifest)
    assert main(["compare", str(old), str(new)]) == 0
    printed = capsys.readouterr().out
    assert said in printed
    assert ("also changed" in printed) == bool(said)


def test_a_control_that_was_not_flown_any_more_is_named_and_counts(
    tmp_path: Path, capsys: Capture
) -> None:
    old, new = flown_as(tmp_path / "old"), flown_as(tmp_path / "new")
    control = flights("blind", "wil", "F")[0]
    failed = replace(
        control.result(),
        control=ControlResult("a", "FAIL", oracle=None, cause=None, met=True),
    )
    write_control(old, failed)
    assert main(["compare", str(old), str(new)]) == 3
    assert "control not flown any more: blind/wil\n" in capsys.readouterr().out
    assert main(["compare", str(old), str(new), "--removed"]) == 0


@pytest.mark.parametrize(
    ("was", "code", "text"),
    [
        ("4.6.0", 3, "other settings: the firmware of real was ardupilot 4.6.0"),
        ("4.6.1", 0, ""),
        (None, 0, ""),
    ],
    ids=["another", "same", "unknown before"],
)
def test_another_firmware_is_another_test(
    tmp_path: Path,
    capsys: Capture,
    was: str | None,
    code: int,
    text: str,
) -> None:
    for name, version in (("before", was), ("after", "4.6.1")):
        firmware = () if version is None else (replace(BOARD, version=version),)
        write_flown(
            tmp_path / name,
            flights("a", "wil", "P" * 10, TEN, firmware=firmware),
            with_motion=False,
        )
    folders = [str(tmp_path / name) for name in ("before", "after")]
    assert main(["compare", *folders]) == code
    said = capsys.readouterr().out
    assert text in said
    assert ("firmware" in said) == bool(text)
    assert main(["compare", *folders, "--changed"]) == 0


def test_other_parameters_in_the_vehicle_are_named(tmp_path: Path, capsys: Capture) -> None:
    for name, digest in (("before", "0a"), ("after", "0b")):
        firmware = (replace(BOARD, parameters=digest),)
        write_flown(
            tmp_path / name,
            flights("a", "wil", "P" * 10, TEN, firmware=firmware),
            with_motion=False,
        )
    assert main(["compare", str(tmp_path / "before"), str(tmp_path / "after")]) == 0
    said = capsys.readouterr().out
    assert "also changed: real: the digest of its parameters was 0a, now it is 0b" in said


def test_equal_runs_have_no_interval_on_the_page_either(tmp_path: Path) -> None:
    old = write_flown(tmp_path / "old", flights("a", "wil", "P" * 5, [0.1] * 5), with_motion=False)
    new = write_flown(tmp_path / "new", flights("a", "wil", "PPPPF", TEN[:5]), with_motion=False)
    page = tmp_path / "compare.html"
    main(["compare", str(old), str(new), "--page", str(page)])
    text = page.read_text()
    assert "5 of 5 passed<" in text
    assert "4 of 5 passed, interval of 28% to 99%" in text
