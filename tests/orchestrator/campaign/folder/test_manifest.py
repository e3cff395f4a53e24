"""The manifest by which recorded runs are judged, beside that of their flight."""

import json
from functools import cache
from typing import Any

import pytest

from tests.orchestrator.conftest import ROOT
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.campaign.folder.manifest import (
    campaign_manifest,
    judging_manifest,
    world_digest,
)
from wil_campaign.orchestrator.campaign.folder.manifest_changes import changes_since_flight
from wil_campaign.orchestrator.reading.results_folder import flown_requirements

RATE = "recipe.sensors.camera.rate_hz=5"


def flown(file: str, **options: Any) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(
        json.dumps(campaign_manifest(load(file, **options), "virtual"))
    )
    return found


@cache
def load(file: str, **options: Any) -> Any:
    return load_campaign(ROOT / "campaigns" / file, ExpansionOptions(loads_code=False, **options))


def changes(before: dict[str, Any], file: str, **options: Any) -> list[str]:
    now = judging_manifest(load(file, **options), before)
    return changes_since_flight(before, now, file=file)


@pytest.mark.parametrize("file", ["gate.yaml", "table1.yaml"])
@pytest.mark.parametrize("repetitions", [1, 3, None])
def test_which_runs_were_chosen_is_no_change_of_their_files(
    file: str, repetitions: int | None
) -> None:
    before = flown(file, modes=("wil",), repetitions=repetitions)
    assert changes(before, file) == []
    assert changes(before, file, repetitions=2) == []
    before["runs"][0]["documents"] = "sha256:0"
    assert changes(before, file) == [f"the files of {before['runs'][0]['run']} changed"]


@pytest.mark.parametrize("file", ["gate.yaml", "table1.yaml"])
@pytest.mark.parametrize("repetitions", [1, None])
def test_requirements_are_read_back_from_the_manifest(file: str, repetitions: int | None) -> None:
    campaign = load(file, repetitions=repetitions)
    written = flown(file, repetitions=repetitions)
    assert campaign.requirements
    assert flown_requirements(written) == campaign.requirements


@pytest.mark.parametrize("file", ["gate.yaml", "follow.yaml", "avoid.yaml", "table1.yaml"])
def test_each_run_is_recorded_with_the_world_that_it_flies_in(file: str) -> None:
    """One whose objects draw their speeds has the seed of its run: no two are the same."""
    campaign = load(file, repetitions=2)
    worlds = {run["run"]: run["world"] for run in flown(file, repetitions=2)["runs"]}
    assert worlds == {plan.name: world_digest(plan.files) for plan in campaign.plans}


def test_changed_files_are_named_when_repetitions_changed_too() -> None:
    before = flown("gate.yaml", cases=("large",), repetitions=1, sets=(RATE,))
    before["options"]["set"] = []
    said = [f"the files of large/{mode}/1 changed" for mode in ("sim", "wil")]
    assert changes(before, "gate.yaml") == said
