"""The page of a search: what was tried, what failed, and nothing of a file acts in it."""

from pathlib import Path
from typing import Any

from tests.plugins.search.exploration.made_up import corner, number, plane, problem, searched
from tests.plugins.search.searches import write_search
from wil_campaign.orchestrator.run_results.run_result import Stop
from wil_campaign.plugins.search.exploration.coverage import space_coverage_of
from wil_campaign.plugins.search.exploration.model import SearchFindings, SearchVariant
from wil_campaign.plugins.search.exploration.search_file import load_search
from wil_campaign.plugins.search.exploration.sensed import (
    SensedCoverage,
    SensedView,
    sensed_coverage,
)
from wil_campaign.plugins.search.exploration.space import SearchSpace, SpaceParameter, Values
from wil_campaign.plugins.search.report.search_report import SearchPage, render_search
from wil_campaign.plugins.search.search_command import search_text
from wil_campaign.plugins.search.search_document import unsettled_texts
from wil_campaign.plugins.search.search_runner import SearchOutcome, search_exit_code


def page_of(
    space: SearchSpace,
    findings: SearchFindings,
    *,
    campaign: str = "gate",
    stopped: Stop | None = None,
    is_broken: bool = False,
    sensed: tuple[SensedCoverage, ...] = (),
) -> str:
    page = SearchPage(
        campaign=campaign,
        strategy="sobol",
        objective=("collision",),
        ended=findings.ended,
        exit_code=search_exit_code(findings, stopped=stopped, is_broken=is_broken),
        unsettled=tuple(unsettled_texts(findings)),
        files={one.variant.name: f"failures/{one.variant.name}.yaml" for one in findings.confirmed},
        coverage=space_coverage_of(space, findings.proven_values),
        sensed=sensed,
    )
    return render_search(page, space, findings, made_utc="2026-11-22T20:00:00Z")


def test_the_page_draws_each_pair_of_parameters_with_every_variant_in_it() -> None:
    def refuse(variant: SearchVariant) -> str:
        values = {"z": 0.0, **variant.values}
        return "starts outside" if number(values, "z") < -0.8 else ""

    space = plane(z=1, constraints=("x + y <= 1.8",))
    given = problem(space, budget={"sim": 60}, refuse=refuse, confirm_most=1, reduce_flights=10)
    findings, _ = searched(given, corner, strategy="sobol")
    html = page_of(space, findings)
    assert html.count("<svg") == 3
    failed = sum(one.failed("sim") for one in findings.tried)
    assert failed > 0
    assert html.count('class="fail"') == 3 * failed
    assert html.count('class="pass"') == 3 * (len(findings.tried) - failed)
    assert html.count('class="refused"') == 3 * len(findings.refused) > 0
    (case,) = findings.confirmed
    assert html.count('class="confirmed"') == html.count('class="reduced"') == 3
    assert html.count('class="own"') == 3
    assert f'href="./failures/{case.variant.name}.yaml"' in html
    assert f'<td>explore</td><td class="num">{len(findings.tried)}</td>' in html


def test_the_page_names_a_case_that_fails_as_it_is() -> None:
    space = plane()
    findings, _ = searched(problem(space, budget={"sim": 1}), lambda *_: -1.0, strategy="sobol")
    assert "<bdi>nothing: the case fails as it is</bdi> (5/5)" in page_of(space, findings)


def test_the_page_is_green_for_exit_code_0_alone() -> None:
    space = plane()

    def page(share: float, **more: Any) -> str:
        """Return the page where a share of the space passes, and the rest proves nothing."""
        given = problem(space, budget={"sim": 8}, reduce_flights=0)
        findings, _ = searched(
            given,
            lambda values, *_: 1.0 if number(values, "x") <= 2.0 * share - 1.0 else None,
            strategy="sobol",
        )
        return page_of(space, findings, **more)

    green = '<header class="top good">'
    assert green in page(1.0)
    assert green not in page(1.0, stopped="signal")
    assert green not in page(1.0, is_broken=True)
    assert green in page(0.75)
    assert "2 of 8 variants proved nothing (no PASS, no FAIL)" in page(0.75)
    assert green not in page(0.25)
    assert "6 of 8 variants proved nothing (no PASS, no FAIL)" in page(0.25)


def test_a_failure_stays_one_where_the_dearer_mode_proved_nothing(tmp_path: Path) -> None:
    """It is an open failure, and was drawn as nothing and counted as none."""
    given = problem(plane(), budget={"sim": 8, "wil": 8}, reduce_flights=0)
    findings, _ = searched(given, lambda _, mode, __: -1.0 if mode == "sim" else None)
    assert len(findings.open_failures) == 8
    html = page_of(plane(), findings)
    assert html.count('class="fail"') == 8
    assert 'class="nothing"' not in html
    search = load_search(write_search(tmp_path))
    outcome = SearchOutcome(findings=findings, folder=tmp_path, ended="", files={}, exit_code=3)
    assert "8 variants flown, 8 failed" in search_text(search, outcome)


def test_variants_that_proved_nothing_cover_nothing() -> None:
    """Where x is above 0.2 all is INVALID: 25 of 25 pairs of cells were covered."""
    space = plane()
    findings, _ = searched(
        problem(space, budget={"sim": 64}),
        lambda values, *_: None if number(values, "x") > 0.2 else 1.0,
        strategy="sobol",
    )
    html = page_of(space, findings)
    assert "15 of 25 admissible pairs of cells were flown (60 %)" in html
    assert html.count('class="unexplored"') == 10
    covered = space_coverage_of(space, findings.proven_values)
    assert covered.farthest is not None
    assert number(covered.farthest, "x") > 0.9


def test_the_page_draws_a_cell_for_each_choice() -> None:
    forms = SpaceParameter(name="form", keys=("form",), choices=tuple("abcdefgh"), own="a")
    space = SearchSpace(parameters=(forms,))
    given = problem(space, budget={"sim": 5}, at_once=1, reduce_flights=0)
    findings, _ = searched(given, lambda *_: 1.0, strategy="grid")
    html = page_of(space, findings)
    # The one parameter is drawn on both axes, so that the diagonal is all there is.
    counts = [html.count(f'class="{kind}"') for kind in ("cell", "unexplored", "shut")]
    assert counts == [5, 3, 56]
    assert "5 of 8 admissible pairs of cells were flown (62 %)" in html


def test_the_campaigns_own_value_is_not_drawn_where_it_is_none_of_the_choices() -> None:
    forms = SpaceParameter(name="form", keys=("form",), choices=("square", "round"), own="hexagon")
    space = SearchSpace(parameters=(forms,))
    findings, _ = searched(problem(space), lambda *_: 1.0, strategy="grid")
    html = page_of(space, findings)
    assert 'class="own"' not in html
    assert html.count('class="pass"') == 2


def test_the_page_draws_what_each_sensor_saw_and_where_flights_failed() -> None:
    findings, _ = searched(problem(plane(), budget={"sim": 4}), corner, strategy="sobol")
    seen = SensedView(sensor="camera", object="<gate>", cells=((0, 1), (7, 5)), nearest_m=0.75)
    never = SensedView(sensor="camera", object="intruder")
    html = page_of(plane(), findings)
    assert "What the sensors saw" not in html
    sensed = sensed_coverage([((seen, never), True), ((never,), False)])
    html = page_of(plane(), findings, sensed=sensed)
    assert "What the sensors saw" in html
    assert html.count('class="unexplored"') >= 2 * 48 - 2
    assert html.count("1 flights, 1 of them failed") == 4
    assert html.count('class="seen failed"') == 2
    assert "&lt;gate&gt; by camera</bdi>: seen in 1 of 1 flights, as near as 0.75 m" in html
    assert "intruder by camera</bdi>: seen in none of 2 flights" in html


def test_names_from_a_file_are_text() -> None:
    choices = ("<script>alert(1)</script>", "b")
    space = SearchSpace(
        parameters=(SpaceParameter(name="form", keys=("form",), choices=choices, own="b"),)
    )

    def bad(values: Values, mode: str, seed: int) -> float:
        del values, mode, seed
        return -1.0

    findings, _ = searched(problem(space, reduce_flights=0), bad, strategy="grid")
    html = page_of(space, findings, campaign="<b>gate</b>")
    assert "<script" not in html
    assert "<b>gate" not in html
    assert "&lt;script&gt;" in html
