"""The search of a campaign file: what it says, and every fault of it with its place."""

import re
from pathlib import Path

import pytest

from tests.plugins.search.searches import SEARCH, write_search
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.plugins.search.exploration.model import SearchVariant
from wil_campaign.plugins.search.exploration.search_file import load_search

SHIPPED = Path(__file__).parents[4] / "campaigns"

WRONG = [
    # what of the search is replaced, by what, and what is said of it, at "^"
    ("key: goal.altitude_m", "key: ^goal.altitude", "did you mean"),
    ("key: goal.altitude_m", "key: ^gole.altitude_m", "did you mean"),
    ("key: goal.altitude_m", "key: ^world.objects.gate.pose.east_m", "missing key"),
    ("key: goal.altitude_m", "key: ^recipe.combine", "the campaign has no recipe"),
    ("key: goal.altitude_m", "key: ^repetitions", "is the same for all cases"),
    (
        "key: goal.altitude_m",
        "key: [goal.altitude_m, ^goal.altitude_m]",
        "is already varied by 'height'",
    ),
    ("steps: 3", "steps: 3, ^more: 1", "unknown key 'more'"),
    ("from: 0.8, to: 2.0", "from: 2, to: ^1", "must be above from"),
    ("from: 0.8, to: 2.0", "from: -1.0e+308, to: ^1.0e+308", "is too far from from"),
    ("from: 0.8, to: 2.0", "from: ^0.5, to: 2, integer: true", "must be a whole number"),
    ("from: 0.8, to: 2.0", "choices: ^[1.5]", "at least 2 entries"),
    ("from: 0.8, to: 2.0, steps: 3", "choices: [1, 2], steps: ^3", "has no effect with choices"),
    ("objective: altitude", "objective: ^altitud", "did you mean 'altitude'?"),
    ("objective: altitude", "objective: ^landed", "judges an event and has no margin"),
    ("objective: altitude", "objective: [altitude, ^landed]", "has no margin"),
    (
        "objective: altitude",
        "objective: altitude\n  scale: {^speed: 2}",
        "is not an oracle of the objective",
    ),
    ("budget: {sim: 3}", "budget: {sim: ^0}", "must be at least 1"),
    ("budget: {sim: 3}", "budget: ^{}", "give flights for at least one mode"),
    ("budget: {sim: 3}", "budget: {^real: 3}", "mode 'real' is not flown"),
    ("budget: {sim: 3}", "seeds: 4\n  budget: {sim: ^3}", "is less than the 4 flights"),
    ("budget: {sim: 3}", "case: ^gusty\n  budget: {sim: 3}", "unknown case 'gusty'"),
    ("strategy: grid", "strategy: ^cma-es", "at least 2 parameters"),
    ("strategy: grid", "strategy: ^annealing", "must be"),
    ("strategy: grid", "constraints: ['height > ^3 s']", "a number has no unit"),
    ("strategy: grid", "constraints: ['^heigth > 1']", "unknown parameter 'heigth'; did you"),
    ("strategy: grid", "^constraints: ['height > 3']", "leave no variant"),
    ("most: 1", "at_least: ^3", "is more than the 2 flights"),
]


@pytest.mark.parametrize(("old", "new", "said"), WRONG)
def test_a_wrong_search_is_refused_with_the_place(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    marked = SEARCH.replace(old, new)
    assert marked != SEARCH
    path = write_search(tmp_path, marked.replace("^", ""))
    before = marked.partition("^")[0]
    head = len(path.read_text().splitlines()) - len(marked.splitlines())
    line, column = head + before.count("\n") + 1, len(before.rpartition("\n")[2]) + 1
    with pytest.raises(BadInput) as caught:
        load_search(path)
    found = [(problem.line, problem.column, problem.headline) for problem in caught.value.problems]
    near = [text for at, col, text in found if at == line and said in text]
    assert near, found
    is_text = "constraints: ['" in new
    assert any(col == column for at, col, text in found if said in text) or is_text, found


@pytest.mark.parametrize(
    ("oracle", "budget", "said"),
    [
        ("{use: twin_divergence, max_m: 1}", "{wil: 9}", "give it required: true"),
        ("{use: altitude, max_m: 2, required: false}", "{sim: 9}", "fails no flight"),
        (
            "{use: twin_divergence, max_m: 1, required: true}",
            "{sim: 9, wil: 9}",
            "compares real and twin, and in mode sim only twin flies: remove sim from the budget",
        ),
        (
            "{use: altitude, max_m: 2, vehicle: real}",
            "{sim: 9, wil: 9}",
            "judges real alone, and mode sim is judged by twin",
        ),
        (
            "{use: altitude, max_m: 2, vehicle: twin}",
            "{sim: 9, wil: 9}",
            "judges twin alone, and mode wil is judged by real",
        ),
        ("{use: twin_divergence, max_m: 1, required: true}", "{wil: 9}", ""),
        ("{use: altitude, max_m: 2, vehicle: twin}", "{sim: 9}", ""),
    ],
)
def test_an_objective_that_cannot_fail_a_flight_of_the_budget_is_refused(
    oracle: str, budget: str, said: str
) -> None:
    sets = ("oracles.low=" + oracle, f"search.budget={budget}", "search.objective=low")
    options = ExpansionOptions(sets=(*sets, "search.scale={}"))
    if not said:
        assert load_search(SHIPPED / "search-gate.yaml", options).part.oracles == ("low",)
        return
    with pytest.raises(BadInput) as caught:
        load_search(SHIPPED / "search-gate.yaml", options)
    (problem,) = caught.value.problems
    assert problem.message.startswith("oracle 'low'")
    assert said in problem.message


def test_a_campaign_without_a_search_and_one_of_campaigns_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="has no `search`"):
        load_search(write_search(tmp_path, ""))
    whole = tmp_path / "whole.yaml"
    whole.write_text("schema: wil/campaign/1\ncampaign: all\ncampaigns: {one: hover.yaml}\n")
    with pytest.raises(BadInput, match="a search varies a single one"):
        load_search(whole)


def test_a_parameter_knows_its_unit_and_the_campaigns_own_value(tmp_path: Path) -> None:
    search = load_search(write_search(tmp_path))
    (height,) = search.space.parameters
    assert (height.unit, height.own, height.levels) == ("m", 1.2, (0.8, 1.4, 2.0))
    assert search.overrides({"height": 1.4}) == {"goal.altitude_m": 1.4}
    changed = load_search(
        tmp_path / "hover.yaml",
        ExpansionOptions(seed=9, sets=("goal.altitude_m=0.9", "search.reduce=0")),
    )
    assert changed.space.parameters[0].own == 0.9
    assert (changed.part.reduce, changed.campaign.seed) == (0, 9)


def test_the_gate_of_the_shipped_search_cannot_stand_outside_of_the_fence() -> None:
    search = load_search(SHIPPED / "search-gate.yaml")
    assert [
        (parameter.name, parameter.unit, parameter.own) for parameter in search.space.parameters
    ] == [
        ("aside", "m", 1.1),
        ("turned", "deg", 0),
        ("size", "m", 1.0),
    ]
    assert not search.refuse(SearchVariant(name="v1", values={"aside": -1.5}))
    said = search.refuse(SearchVariant(name="v2", values={"aside": -2.8}))
    assert re.search(r"'gate' is .* geofence", said)
    assert not search.space.admits({"aside": 1.9, "size": 1.1})
