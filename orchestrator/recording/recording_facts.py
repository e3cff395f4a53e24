"""What run.mcap tells of its run before all readings, so that it can be mixed anew from it."""

import json
from collections.abc import Mapping
from pathlib import Path

from orchestrator.state.run_setup import RunSetup
from recipes.language.recipe_document import load_recipe
from recipes.model.recipe import Recipe
from worlds.files.documents import parse


def facts_of(setup: RunSetup) -> dict[str, str]:
    """Return a run's facts for its recording: its name, recipe, ids of the twin's objects."""
    plan = setup.order.plan
    objects = {thing.name: thing.object_id for thing in setup.virtual_scene.objects}
    facts = {
        "case": plan.case,
        "mode": plan.mode,
        "rep": str(plan.repetition),
        "seed": str(plan.seed),
        "objects": json.dumps(objects),
    }
    latencies = {
        f"{vehicle.name} {camera.name}": camera.source.latency_s
        for vehicle in setup.with_sensors
        for camera in vehicle.cameras
        if camera.source is not None
    }
    if latencies:
        facts["latency_s"] = json.dumps(latencies)
    recipe = setup.campaign.recipe
    if recipe is not None and plan.mode == "wil":
        # JSON is YAML: the recipe as it was flown, overrides of a case included.
        facts["recipe"] = json.dumps(recipe.document.data)
        facts["recipe_file"] = str(recipe.document.path)
    return facts


def recipe_in(facts: Mapping[str, str], *, loads_code: bool) -> Recipe | None:
    """Return the recipe in a recording's facts; None where nothing was mixed. Raises BadInput.

    loads_code: whether steps of the user's that it names are loaded; False: no file is run.
    """
    text = facts.get("recipe")
    if text is None:
        return None
    file = facts.get("recipe_file", "recipe.yaml")
    name = f"{file} (as recorded)"
    document = parse(text.encode(), name=name, path=Path(file))
    return load_recipe(document, loads_code=loads_code)


def latencies_in(facts: Mapping[str, str]) -> dict[str, float]:
    """Return a recording's camera latencies by vehicle and camera, as subtracted in flight."""
    found: dict[str, float] = json.loads(facts.get("latency_s", "{}"))
    return found


def objects_in(facts: Mapping[str, str]) -> dict[str, int]:
    """Return the object ids in a recording's facts."""
    found: dict[str, int] = json.loads(facts.get("objects", "{}"))
    return found
