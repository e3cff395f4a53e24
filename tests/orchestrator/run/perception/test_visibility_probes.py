"""Which virtual objects a combination has to show, and which it leaves out by name."""

from pathlib import Path

import pytest

from orchestrator.run.perception.visibility_probes import sought_objects
from recipes.language.recipe_files import load_recipe_file

THINGS = {2: "gate", 3: "intruder", 4: "decoy"}
RECIPE = """\
schema: wil/recipe/1
sensors: {camera: {type: camera, rate_hz: 15}}
combine:
  - sensor: camera
    filter: [FILTER]
    merge: {overlay: {priority: [twin, real]}}
"""


@pytest.mark.parametrize(
    ("filter_", "shows", "named", "sought", "left_out"),
    [
        ("isolate_color: {name: orange}", "", (), {2, 3, 4}, set()),
        ("isolate_objects: [decoy]", "", (), {4}, {2, 3}),
        ("isolate_objects: [decoy]", "", ("intruder", "cage"), {3, 4}, {2}),
        ("isolate_objects: [cage]", "", (), {2, 3, 4}, set()),
        ("isolate_objects: [decoy]", "[decoy]", ("intruder",), {4}, {2, 3}),
        ("isolate_objects: [decoy]", "[cage]", (), set(), {2, 3, 4}),
    ],
    ids=["by colour", "by name", "named by an oracle", "of both worlds", "said", "none"],
)
def test_what_goal_and_oracles_name_has_to_be_shown_and_the_rest_is_left_out(  # noqa: PLR0917 - a table
    tmp_path: Path,
    filter_: str,
    shows: str,
    named: tuple[str, ...],
    sought: set[int],
    left_out: set[int],
) -> None:
    text = RECIPE.replace("FILTER", f"{{{filter_}}}")
    (tmp_path / "recipe.yaml").write_text(text + (f"    shows: {shows}\n" if shows else ""))
    (combination,) = load_recipe_file(tmp_path / "recipe.yaml").combinations
    virtual = sought_objects(combination, THINGS, named)
    assert (set(virtual.names), set(virtual.not_mixed)) == (sought, left_out)
