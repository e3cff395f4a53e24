"""`wil-campaign list`: what is at hand."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

import campaigns
from campaigns.under_test import shipped_autonomies
from orchestrator.cli.streams import out
from orchestrator.cli.text import table
from recipes.registry import steps
from safety.oracles import registry
from worlds.documents import BadInput, load

What = Literal["campaigns", "operators", "autonomies", "oracles"]
Row = dict[str, str]


def list_things(
    what: What, *, json_: Annotated[bool, Parameter(name="--json", negative=())] = False
) -> int:
    """List campaigns, operators and the like.

    Parameters
    ----------
    what
        campaigns: of ./campaigns and those that come with the program; operators: steps of
        recipes; autonomies: what `autonomy.use` may name; oracles: what `oracles` may name.
    json_
        Print one JSON document.
    """
    rows = _LISTS[what]()
    if json_:
        out(json.dumps(rows, indent=2, ensure_ascii=False))
    elif rows:
        out(table(tuple(rows[0]), [tuple(row.values()) for row in rows]))
    return 0


def _campaigns() -> list[Row]:
    folders = (Path("campaigns"), Path(campaigns.__file__).parent)
    files = {path.resolve(): path for folder in reversed(folders) for path in folder.glob("*.yaml")}
    return [_campaign(path) for path in sorted(files.values())]


def _campaign(path: Path) -> Row:
    """Return the name and description that a file gives, checked no further."""
    try:
        document = load(path)
    except BadInput as error:
        return {"name": "?", "file": str(path), "description": error.problems[0].message}
    name, description = document.get(("campaign",)), document.get(("description",))
    return {"name": str(name or "?"), "file": str(path), "description": str(description or "")}


def _operators() -> list[Row]:
    return [
        {
            "name": step.name,
            "stage": step.stage,
            "sensors": ", ".join(step.sensors),
            "parameters": ", ".join(step.parameters.model_fields),
            "summary": step.summary,
        }
        for step in steps()
    ]


def _autonomies() -> list[Row]:
    return [{"name": each.name, "summary": each.summary} for each in shipped_autonomies()]


def _oracles() -> list[Row]:
    return [
        {
            "name": name,
            "parameters": ", ".join(spec.parameters.model_fields),
            "summary": spec.summary,
        }
        for name, spec in sorted(registry.items())
    ]


_LISTS: dict[What, Callable[[], list[Row]]] = {
    "campaigns": _campaigns,
    "operators": _operators,
    "autonomies": _autonomies,
    "oracles": _oracles,
}
