"""What a campaign's manifest says otherwise than the one that it was flown by."""

from typing import Any

import pytest

from wil_campaign.orchestrator.campaign.folder.manifest_changes import changes_since_flight


def manifest(**changes: Any) -> dict[str, Any]:
    return {
        "options": {"set": []},
        "versions": {"wil-campaign": "1", "numpy": "2"},
        "files": {"gate.yaml": "a", "profiles/own.yaml": "b"},
        "runs": [{"run": "large/sim/1", "documents": "c"}],
        "document": {"oracles": {"altitude": {"max_m": 2.3}, "landed": {}}, "repetitions": 5},
        **changes,
    }


STUDY = {"campaigns": {"gate": "gate.yaml"}}


@pytest.mark.parametrize(
    ("before", "now", "said"),
    [
        ({}, {}, []),
        (
            {},
            {"document": {"oracles": {"altitude": {"max_m": 9}}, "repetitions": 1}},
            [
                "oracles.altitude.max_m was 2.3, now it is 9",
                "oracles.landed was {}, now it is null",
            ],
        ),
        (
            {"document": {"repetitions": 5}},
            {"document": {"repetitions": {"until": "decided"}}},
            ['repetitions was 5, now it is {"until": "decided"}'],
        ),
        ({}, {"files": {"gate.yaml": "z", "profiles/own.yaml": "b"}}, []),
        ({}, {"files": {"profiles/own.yaml": "z"}}, ["profiles/own.yaml changed"]),
        ({}, {"files": {"new.yaml": "z"}}, []),
        (
            {"options": {"set": ["recipe.b=2", "goal.altitude_m=1"]}},
            {"options": {"set": ["recipe.b=3"]}},
            ["--set recipe.b=3 was not given", "--set recipe.b=2 is not given"],
        ),
        (
            {"document": STUDY},
            {"document": STUDY, "options": {"set": ["vehicles.twin.body={width_m: 1}"]}},
            ["--set vehicles.twin.body={width_m: 1} was not given"],
        ),
        ({}, {"versions": {"wil-campaign": "2"}}, ["wil-campaign was 1, now it is 2"]),
        (
            {"plugins": {"sonar": "wil-sonar 1.2"}},
            {"plugins": {"sonar": "wil-sonar 1.3", "farm": "farm 1"}},
            [
                "the plugin farm was not there, now it is farm 1",
                "the plugin sonar was wil-sonar 1.2, now it is wil-sonar 1.3",
            ],
        ),
        ({}, {"plugins": {"sonar": "wil-sonar 1.3"}}, []),
        (
            {},
            {"runs": [{"run": "large/sim/1", "documents": "z"}]},
            ["the files of large/sim/1 changed"],
        ),
        ({}, {"runs": [{"run": "large/sim/2", "documents": "z"}]}, []),
        (
            {"runs": [{"run": "large/sim/1", "doauments": "c"}]},
            {},
            ["the files of large/sim/1 changed"],
        ),
        ({"runs": [None, {"documents": "c"}, {"run": ["a"], "documents": "c"}]}, {}, []),
    ],
)
def test_a_change_that_alters_the_judgement_is_named(
    before: dict[str, Any], now: dict[str, Any], said: list[str]
) -> None:
    found = changes_since_flight(manifest(**before), manifest(**now), file="gate.yaml")
    assert found == said
    assert changes_since_flight({}, manifest(), file="gate.yaml"), "a manifest that says nothing"


def test_long_values_are_cut() -> None:
    now = manifest(document={**manifest()["document"], "description": "x" * 500})
    (said,) = changes_since_flight(manifest(), now, file="gate.yaml")
    assert len(said) < 130
