"""The space of a search: values, constraints, what of it was flown; and its objective."""

import pytest

from tests.plugins.search.exploration.made_up import number, plane
from wil_campaign.plugins.search.exploration.constraints import parse_constraint
from wil_campaign.plugins.search.exploration.coverage import space_coverage_of
from wil_campaign.plugins.search.exploration.objective import (
    SearchObjective,
    lacks_margin,
    margin_divisor,
)
from wil_campaign.plugins.search.exploration.reduction import (
    Attempts,
    reduced_variants,
    values_without_own,
)
from wil_campaign.plugins.search.exploration.space import SearchSpace, SpaceParameter, Values
from wil_campaign.plugins.search.search_part import ParameterValue
from wil_campaign.plugins.stl.formula import StlError
from wil_campaign.plugins.stl.units import SignalKind
from wil_campaign.safety.evaluation.judge import OracleUse
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.oracles.registry import oracle_kinds

NUMBER = {"n": SignalKind("n", "")}
METRES = {"aside": SignalKind("m", ""), "size": SignalKind("m", ""), "wait": SignalKind("s", "")}


def test_values_are_rounded_so_that_a_person_can_read_them() -> None:
    wide = SpaceParameter(name="turned", keys=("a",), low=-60.0, high=60.0)
    assert (wide.at(0.0), wide.at(0.123456789), wide.at(1.0)) == (-60.0, -45.2, 60.0)
    assert SpaceParameter(name="x", keys=("a",), low=0.1, high=0.2).at(0.123456789) == 0.1123
    counted = SpaceParameter(name="n", keys=("a",), low=1, high=3, is_integer=True)
    assert [counted.at(share) for share in (0.0, 0.34, 0.67, 1.0)] == [1, 2, 3, 3]
    assert counted.levels == (1, 2, 3)
    named = SpaceParameter(name="f", keys=("a",), choices=("square", True, 1))
    assert [named.at(named.share(value) or 0.0) for value in ("square", 1)] == ["square", True]


@pytest.mark.parametrize("own", [2.5, -1.1, "auto", True])
def test_an_own_value_that_is_none_of_the_space_has_no_place_in_it(own: ParameterValue) -> None:
    """A number outside of the limits, and none of the choices."""
    number_of = SpaceParameter(name="x", keys=("x",), low=-1.0, high=2.0, own=own)
    choice = SpaceParameter(name="y", keys=("y",), choices=("square", "round"), own=own)
    for one in (number_of, choice):
        assert SearchSpace(parameters=(one,)).shares({}) is None
    assert SearchSpace(parameters=(number_of,)).shares({"x": 2.0}) == (1.0,)


@pytest.mark.parametrize(
    ("text", "values", "holds"),
    [
        ("abs(aside) + 0.5 * size <= 1.6", {"aside": -1.0, "size": 1.2}, True),
        ("abs(aside) + 0.5 * size <= 1.6", {"aside": -1.1, "size": 1.2}, False),
        ("aside > 1 or not (size > 1)", {"aside": 0.0, "size": 1.0}, True),
        ("aside > 1 implies size < 1", {"aside": 2.0, "size": 1.0}, False),
        ("aside > 1 iff size > 1", {"aside": 2.0, "size": 0.5}, False),
        ("0 <= aside <= 1", {"aside": 0.0}, True),
        ("aside / size > 0", {"aside": 0.0, "size": 0.0}, False),
        ("aside > 0", {}, False),
    ],
)
def test_a_constraint_is_evaluated(text: str, values: Values, holds: bool) -> None:
    whole = {name: values.get(name) for name in METRES}
    assert parse_constraint(text, METRES).holds(whole) is holds


@pytest.mark.parametrize(
    ("text", "offset", "message"),
    [
        ("aside + wait <= 1", 6, "m cannot be added to s"),
        ("aside <= asside", 9, "unknown signal 'asside'"),
        ("always (aside <= 1)", 0, "no time"),
        ("aside <= 1 and (aside until size)", 22, "no time"),
        ("__import__('os')", 11, "is not part of the language"),
    ],
)
def test_a_wrong_constraint_is_refused_where_it_is_wrong(
    text: str, offset: int, message: str
) -> None:
    with pytest.raises(StlError, match=message) as caught:
        parse_constraint(text, METRES)
    assert caught.value.offset == offset


def test_coverage_counts_admissible_pairs_of_cells_and_knows_the_farthest_point() -> None:
    half = plane(constraints=("x + y <= 0",))
    empty = space_coverage_of(half, [])
    # Of 5 x 5 cells, those on and below the diagonal.
    assert (empty.cells, empty.flown, empty.share) == (15, 0, 0.0)
    one = space_coverage_of(half, [{"x": -0.9, "y": 0.85}])
    assert (one.cells, one.flown) == (15, 1)
    assert one.farthest is not None
    assert number(one.farthest, "x") > 0.7
    assert number(one.farthest, "y") < -0.9
    every = space_coverage_of(plane(), list(plane().grid()))
    assert (every.cells, every.flown, every.share) == (25, 25, 1.0)
    assert every.distance < one.distance


def test_each_choice_is_a_cell_and_whole_numbers_of_a_long_range_share_cells() -> None:
    eight = SpaceParameter(name="form", keys=("form",), choices=tuple("abcdefgh"))
    counted = SpaceParameter(name="count", keys=("count",), low=1, high=10, is_integer=True)
    alone = space_coverage_of(SearchSpace(parameters=(eight,)), [{"form": one} for one in "abcde"])
    assert (alone.cells, alone.flown) == (8, 5)
    both = SearchSpace(parameters=(eight, counted))
    found = space_coverage_of(both, [{"form": "a", "count": one} for one in range(1, 11)])
    assert (found.cells, found.flown) == (8 * 5, 5)


def test_where_every_variant_was_flown_nothing_is_far_from_them() -> None:
    form = SpaceParameter(name="form", keys=("form",), choices=("square", "round"))
    counted = SpaceParameter(name="n", keys=("n",), low=0, high=2, is_integer=True, steps=2)
    values = [{"form": one, "n": n} for one in form.choices for n in range(3)]
    found = space_coverage_of(SearchSpace(parameters=(form, counted)), values)
    assert (found.share, found.distance, found.farthest) == (1.0, 0.0, None)
    more = SearchSpace(
        parameters=(form, counted), constraints=(parse_constraint("n >= 1", NUMBER),)
    )
    found = space_coverage_of(more, [one for one in values if one["n"] != 0])
    assert (found.cells, found.flown, found.farthest) == (2, 2, None)


def test_no_cell_is_missed_where_nothing_is_excluded() -> None:
    """More pairs of cells than there are samples."""
    many = [
        SpaceParameter(name=name, keys=(name,), choices=tuple(range(70)))
        for name in ("one", "other")
    ]
    found = space_coverage_of(SearchSpace(parameters=tuple(many)), [{"one": 0, "other": 0}])
    assert (found.cells, found.flown) == (4900, 1)


def result(
    name: str, *, margin: float | None, limit: float | None = 0.0, vehicle: str = "real"
) -> OracleResult:
    return OracleResult(name, vehicle, True, "PASS", None, limit, "m", margin, None)


def test_margins_of_several_units_are_divided_by_their_measure() -> None:
    objective = SearchObjective(oracles=("clearance", "time_limit"), scale={"clearance": 0.5})
    results = [
        result("clearance", margin=0.4, limit=0.1),
        result("time_limit", margin=20.0, limit=40.0),
        result("altitude", margin=0.001, limit=2.3),
        result("clearance", margin=-1.0, vehicle="twin"),
    ]
    assert objective.value(results, vehicle="real") == 0.5
    assert SearchObjective(oracles=("reached",), scale={}).value(results, vehicle="real") is None
    assert [
        margin_divisor(one) for one in (None, 0.0, -4.0, (1.0, 4.0), (None, 4.0), (2.0, None))
    ] == [
        1.0,
        1.0,
        4.0,
        1.5,
        4.0,
        2.0,
    ]


@pytest.mark.parametrize(
    ("verdict", "margin", "value"),
    [("PASS", 0.2, 0.2), ("PASS", None, None), ("FAIL", 0.2, 0.0), ("FAIL", -0.3, -0.3),
     ("FAIL", None, 0.0), ("INVALID", -0.3, None), ("ERROR", 0.2, None)],
)  # fmt: skip
def test_a_failure_is_never_above_0_and_an_unproven_flight_has_no_value(
    verdict: str, margin: float | None, value: float | None
) -> None:
    outcome = SearchObjective(oracles=("reached",), scale={}).outcome(
        verdict=verdict,  # type: ignore[arg-type]
        results=[result("reached", margin=margin)],
        vehicle="real",
        cause="reached/real",
        reason="",
        duration_s=1.0,
        wall_s=1.0,
    )
    assert outcome.value == value


def test_oracles_that_judge_events_have_no_margin() -> None:
    def lacks(kind: str, **parameters: object) -> str:
        model = oracle_kinds()[kind].parameters
        return lacks_margin(OracleUse(kind, kind, model.model_validate(parameters)))

    assert "has no margin" in lacks("landed")
    assert "has no margin" in lacks("vehicle_fault")
    assert "give it max_m" in lacks("twin_divergence")
    assert not lacks("twin_divergence", max_m=1.0)
    assert not lacks("collision")
    assert not lacks("stl", stl="always (up_m <= 2)")


def test_keys_are_left_out_in_halves_and_then_one_by_one() -> None:
    space = SearchSpace(
        parameters=tuple(
            SpaceParameter(name=name, keys=(name,), choices=("own", "other"), own="own")
            for name in "abcdefgh"
        )
    )
    failing = dict.fromkeys("abcdefgh", "other")
    attempts = reduced_variants(space, failing)
    tries: list[Values] = []
    smallest = _drive(attempts, tries)
    assert smallest == {"b": "other", "g": "other"}
    # 2^8 subsets, of which halves and quarters spare most.
    assert len(tries) <= 16


def _drive(attempts: Attempts, tries: list[Values]) -> Values:
    """Reduce what fails as long as b and g are changed."""
    try:
        tries.append(next(attempts))
        while True:
            tries.append(attempts.send({"b", "g"} <= set(tries[-1])))
    except StopIteration as end:
        found: Values = end.value
        return found


def test_a_value_that_is_the_campaigns_own_is_no_change() -> None:
    assert values_without_own(plane(), {"x": 0.0, "y": 0.25}) == {"y": 0.25}
