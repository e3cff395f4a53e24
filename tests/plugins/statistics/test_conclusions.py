"""What follows from the statistics, in words: shown, contradicted, not shown, needed."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.orchestrator.reading.flown_campaign import Flight, flights, write_flown
from wil_campaign.orchestrator.report.campaign_report import write_report
from wil_campaign.plugins.statistics.conclusions import Conclusion, study_conclusions
from wil_campaign.plugins.statistics.gap.gap import CampaignGap
from wil_campaign.plugins.statistics.pass_rates import ModeTest, PassRate, PassRates
from wil_campaign.plugins.statistics.study import Study
from wil_campaign.plugins.statistics.study_text import study_text

SPREAD = (0.0, 0.01, 0.02, 0.03, 0.05)


def campaign(wil_m: float, wil: str = "PPPPP", spread: tuple[float, ...] = SPREAD) -> list[Flight]:
    """Reality flies at 0 beside the way, sim at 0.4 m, wil at wil_m; each with a spread."""
    shifts = {"real": 0.0, "wil": wil_m, "sim": 0.4}
    return [
        flight
        for case in ("large", "small")
        for mode, shift in shifts.items()
        for flight in flights(
            case,
            mode,
            wil if mode == "wil" else "PPPPP",
            [shift + each for each in (spread[::-1] if mode == "wil" else spread)],
        )
    ]


def conclusions_of(folder: Path, given: list[Flight], **more: object) -> list[Conclusion]:
    written = write_flown(folder, given, **more)  # type: ignore[arg-type]
    return study_conclusions(Study.read(written))


def texts(found: list[Conclusion], kind: str) -> str:
    return "\n".join(one.text for one in found if one.kind == kind)


def test_a_claim_that_holds_is_shown_and_equal_passes_are_no_proof(tmp_path: Path) -> None:
    found = conclusions_of(tmp_path / "a", campaign(0.1))
    shown = texts(found, "shown")
    assert "By the mean distance between flights, over all cases: WIL is nearer" in shown
    assert "With the spread of each mode taken into account" in shown
    assert not texts(found, "contradicted")
    alike = texts(found, "not shown")
    assert "No difference in pass rates is shown" in alike
    assert "Equal pass rates are not shown either" in alike


def test_some_of_the_measures_alone_are_no_claim_of_all(tmp_path: Path) -> None:
    study = Study.read(write_flown(tmp_path / "a", campaign(0.1)))
    shown = texts(study_conclusions(study), "shown").splitlines()[0]
    assert shown.endswith("(rmse) (3 of 5 measures; each interval holds alone).")
    paths = tuple(one for one in study.gap.figures if one.part == "behaviour")
    every = replace(study, gap=replace(study.gap, figures=paths))
    assert texts(study_conclusions(every), "shown").splitlines()[0].endswith("(rmse).")


def test_a_claim_that_fails_is_reported_plainly(tmp_path: Path) -> None:
    found = conclusions_of(tmp_path / "a", campaign(0.9))
    contradicted = texts(found, "contradicted")
    assert "WIL is farther from reality than simulation" in contradicted
    assert "the paths (dtw)" in contradicted
    assert "WIL is nearer" not in texts(found, "shown")


def test_a_difference_of_passes_says_what_would_show_it(tmp_path: Path) -> None:
    found = conclusions_of(tmp_path / "a", campaign(0.1, wil="PPPPF"))
    needed = texts(found, "needed")
    assert "simulation and WIL" in needed
    assert "times the flights for" in needed
    apart = conclusions_of(tmp_path / "b", campaign(0.1, wil="FFFFF"))
    assert "The pass rates of the modes differ: simulation and WIL" in texts(apart, "shown")


def test_a_rounded_p_does_not_contradict_what_is_shown() -> None:
    """6 of 8 and 26 of 26 differ by 0.0499, and 8 of 11 and 17 of 17 do not by 0.0504."""
    for p, kind, said in ((0.04991, "shown", "p 0.0499"), (0.05037, "not shown", "p 0.0504")):
        rates = [PassRate("a", mode, 5, 8, 0, False, None) for mode in ("sim", "wil")]
        test = ModeTest("a", "sim", "wil", p)
        study = Study(PassRates(tuple(rates), (test,), ()), CampaignGap())
        assert said in texts(study_conclusions(study), kind)
        assert said in study_text(study)


@pytest.mark.parametrize(
    ("ps", "kind", "said"),
    [
        ([0.03], "shown", "differ: simulation and WIL, p 0.03."),
        ([0.03, 0.03, 1.0], "not shown", "p 0.09; WIL and reality, p 1, corrected for 3 pairs"),
        ([0.01, 0.03, 1.0], "shown", "differ: simulation and WIL, p 0.03, corrected for 3 pairs."),
        ([0.03, None, None], "shown", "differ: simulation and WIL, p 0.03."),
    ],
)
def test_p_is_corrected_for_the_pairs_of_modes(
    ps: list[float | None], kind: str, said: str
) -> None:
    """Each alone, some pair of three that pass alike differed in up to 10 % of campaigns."""
    pairs = [("sim", "wil"), ("sim", "real"), ("wil", "real")]
    rates = [PassRate("a", mode, 5, 8, 0, False, None) for mode in ("sim", "wil", "real")]
    tests = [ModeTest("a", *pair, p) for pair, p in zip(pairs, ps, strict=False)]
    study = Study(PassRates(tuple(rates), tuple(tests), ()), CampaignGap())
    assert said in texts(study_conclusions(study), kind)


@pytest.mark.parametrize(("pairs", "times"), [(1, 6), (3, 7)])
def test_what_is_needed_is_so_for_the_corrected_p(pairs: int, times: int) -> None:
    """29 of 30 beside 30 of 30: 174 of 180 and 203 of 210 beside all have a p of 0.03 and 0.015."""
    passed = {"sim": 30, "wil": 29, "real": 30}
    rates = [PassRate("a", mode, count, 30, 0, False, None) for mode, count in passed.items()]
    tests = [ModeTest("a", "sim", "wil", 1.0), ModeTest("a", "sim", "real", 1.0)]
    tests.append(ModeTest("a", "wil", "real", 1.0))
    study = Study(PassRates(tuple(rates), tuple(tests[:pairs]), ()), CampaignGap())
    found = texts(study_conclusions(study), "needed")
    assert f"{times} times the flights for simulation and WIL" in found


def many_flights(passed: int) -> Study:
    """Return ten cases of 20 flights; of the first, wil passed fewer than sim's 10."""
    rates = [
        PassRate(str(case), mode, passed if case == 0 and mode == "wil" else 10, 20, 0, False, None)
        for case in range(10)
        for mode in ("sim", "wil")
    ]
    return Study(PassRates(tuple(rates), (ModeTest("", "sim", "wil", 0.9),), ()), CampaignGap())


@pytest.mark.parametrize(("passed", "needed"), [(9, ""), (6, "25 times the flights")])
def test_many_flights_are_tested_at_forty_times_their_number(passed: int, needed: str) -> None:
    # In whole numbers this takes minutes.
    found = texts(study_conclusions(many_flights(passed)), "needed")
    assert needed in found
    assert bool(found) == bool(needed)


def test_an_open_question_says_how_many_flights_would_decide_it(tmp_path: Path) -> None:
    wide = (0.0, 0.3, -0.3, 0.15, -0.1)
    found = conclusions_of(tmp_path / "a", campaign(0.3, spread=wide))
    assert "it is undecided whether WIL is nearer" in texts(found, "not shown")
    assert "(5 now)" in texts(found, "needed")


def test_one_mode_alone_concludes_nothing(tmp_path: Path) -> None:
    assert conclusions_of(tmp_path / "a", flights("a", "sim", "PPPPP", SPREAD)) == []


@pytest.mark.parametrize("source", ["Table I", ""])
def test_published_counts_are_named_as_those_of_others(tmp_path: Path, source: str) -> None:
    passed = {"large": {"sim": "5/5", "wil": "1/5", "real": "too costly"}, "small": {"wil": "2/5"}}
    document = {"published": {"source": source, "passed": passed}}
    beside = texts(conclusions_of(tmp_path / "a", campaign(0.1), document=document), "note")
    assert "passes simulation 5 of 5, WIL 3 of 10" in beside
    assert "do not affect the verdict" in beside
    assert source in beside


def test_the_conclusions_come_before_the_tables(tmp_path: Path) -> None:
    folder = write_flown(tmp_path / "a", campaign(0.9))
    text = study_text(Study.read(folder))
    assert text.index("contradicted: ") < text.index("real to sim")
    write_report(folder)
    page = (folder / "report.html").read_text()
    assert page.index("WIL is farther from reality") < page.index("Gap to reality")
