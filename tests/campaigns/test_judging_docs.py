"""docs/oracles.md, geofence.md and preflight.md: every example loads, every oracle has its row."""

import json
import re
from pathlib import Path
from typing import Any, get_args

import pytest

from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.safety.preflight import Check
from wil_campaign.vehicles.autopilots.registry import autopilot_strategies

DOCS = Path(__file__).parents[2] / "docs"


def examples(page: str) -> list[str]:
    return re.findall(r"```yaml\n(.*?)```", (DOCS / page).read_text("utf-8"), re.DOTALL)


@pytest.mark.parametrize(
    "example",
    [text for page in ("oracles.md", "geofence.md", "preflight.md") for text in examples(page)],
)
def test_every_example_is_good(files: Any, example: str) -> None:
    """In its place of a small campaign, whose goal is a gate and, for formulas, a position."""
    corners = [[47.39999, 8.49997], [47.40004, 8.49997], [47.40004, 8.50003], [47.39999, 8.50003]]
    fence = {"polygons": [{"inclusion": True, "polygon": corners}], "circles": []}
    plan = {"fileType": "Plan", "geoFence": fence, "version": 1}
    (files.folder / "cage.plan").write_text(json.dumps(plan))
    text = files.path.read_text()
    for key in ("geofence", "oracles"):
        if example.startswith(f"{key}:"):
            text = re.sub(rf"(?m)^{key}:\n(  .*\n)*", "", text)
    if "goal_distance_m" in example:
        text = text.replace("gates: [gate]", "position: {north_m: 1, east_m: 0, up_m: 1}")
        example += "  reached_position: {tolerance_m: 0.3}\n"
    elif example.startswith("oracles:") and "reached:" not in example:
        example += "  reached: {}\n"
    files.path.write_text(text + example)
    assert files.load().runs


def test_every_check_of_the_preflight_is_documented() -> None:
    page = (DOCS / "preflight.md").read_text("utf-8")
    assert all(f"| `{check}` |" in page for check in get_args(Check))
    for strategy in autopilot_strategies().values():
        rules = strategy.failsafes.rules
        assert all(f"`{name}`" in page for rule in rules for name in rule.names)


def test_every_oracle_has_its_row() -> None:
    """Their keys, windows and signals are in lists.md, which is made from the program."""
    page = (DOCS / "oracles.md").read_text("utf-8")
    rows = {row.split("|")[1].strip(" `") for row in page.splitlines() if row.startswith("| `")}
    assert set(oracle_kinds()) - rows == set()


def test_the_page_of_campaigns_shows_a_goal_of_each_kind(files: Any) -> None:
    page = (DOCS / "campaigns.md").read_text("utf-8")
    (gates, position) = re.findall(r"(?m)^goal: \{(.+?)\} +# or (position: \{.+\})$", page)[0]
    assert "gates" in gates
    files.change("gates: [gate]", position)
    files.change("  reached: {}", "  reached_position: {tolerance_m: 0.3}")
    assert files.load().runs
