"""`wil-campaign list`: lists campaigns, what they can name, and plugins."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from textwrap import wrap
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from wil_campaign import campaigns
from wil_campaign.campaigns.schema.sensors import sensor_parts
from wil_campaign.campaigns.setup.autonomy_under_test import shipped_autonomies
from wil_campaign.foundation.files.documents import BadInput, load_document
from wil_campaign.installed_plugins import installed_plugins_by_name
from wil_campaign.orchestrator.cli.standard_streams import write_stdout
from wil_campaign.orchestrator.cli.text_table import table_lines
from wil_campaign.plugins.start.oracle_docs import (
    OracleParameterDoc,
    common_parameters,
    describe_oracles,
)
from wil_campaign.plugins.start.part_summaries import part_summary
from wil_campaign.plugins.start.step_docs import StepDoc, describe_step
from wil_campaign.recipes.model.registry import registered_steps
from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.vehicles.autopilots.registry import autopilot_strategies
from wil_campaign.vehicles.readings import sensor_names

What = Literal[
    "campaigns", "operators", "autonomies", "oracles", "signals", "sensors", "autopilots", "plugins"
]
Row = dict[str, Any]

_WIDTH = 100
_MEANINGS: dict[What, str] = {
    "campaigns": "those in ./campaigns and those of the program",
    "operators": "steps of recipes",
    "autonomies": "what `autonomy.use` may name",
    "oracles": "what `oracles` may name",
    "signals": "what formulas of oracles (stl) may name",
    "sensors": "their types, and the keys of each",
    "autopilots": "what vehicles may have, from which version on",
    "plugins": "what extends the program, of which distribution, and what each adds",
}


def list_available(
    what: What | None = None,
    *,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """List what campaigns can name: operators, autonomies, oracles, sensors; campaigns; plugins.

    Without WHAT: what there is to list.

    Parameters
    ----------
    what
        campaigns: those in ./campaigns and those of the program; operators: steps of
        recipes; autonomies: what `autonomy.use` may name; oracles: what `oracles` may name;
        signals: what formulas of oracles (stl) may name; sensors: their types, and the keys of
        each; autopilots: what vehicles may have, from which version on; plugins: what extends
        the program, of which distribution, and what each adds.
    json_
        Print one JSON document.
    """
    rows = _subjects() if what is None else _LISTS[what]()
    if json_:
        write_stdout(json.dumps(rows, indent=2, ensure_ascii=False))
    elif what == "oracles":
        write_stdout(_oracle_text())
    elif what == "operators":
        write_stdout(
            "\n".join(
                line for kind in registered_steps() for line in _step_lines(describe_step(kind))
            )
        )
    elif rows:
        write_stdout(table_lines(tuple(rows[0]), [tuple(map(str, row.values())) for row in rows]))
    return 0


def _subjects() -> list[Row]:
    return [{"command": f"wil-campaign list {what}", "lists": _MEANINGS[what]} for what in _LISTS]


def _campaigns() -> list[Row]:
    folders = (Path("campaigns"), Path(campaigns.__file__).parent)
    files = {path.resolve(): path for folder in reversed(folders) for path in folder.glob("*.yaml")}
    return [_campaign(path) for path in sorted(files.values())]


def _campaign(path: Path) -> Row:
    """Return the name and description of a campaign file for the listing, unchecked."""
    try:
        document = load_document(path)
    except BadInput as error:
        return {"name": "?", "file": str(path), "description": error.problems[0].message}
    name, description = document.get(("campaign",)), document.get(("description",))
    return {"name": str(name or "?"), "file": str(path), "description": str(description or "")}


def _operators() -> list[Row]:
    return [asdict(describe_step(kind)) for kind in registered_steps()]


def _autonomies() -> list[Row]:
    return [{"name": each.name, "summary": each.summary} for each in shipped_autonomies()]


def _oracle_rows() -> list[Row]:
    return [asdict(describe_oracles(spec)) for _, spec in sorted(oracle_kinds().items())]


def _signals() -> list[Row]:
    return [
        {"name": name, "unit": unit or "true or false", "meaning": meaning}
        for kind in oracle_kinds().values()
        for name, (unit, meaning) in kind.signals().items()
    ]


def _sensors() -> list[Row]:
    return [
        {
            "name": name,
            "keys": ", ".join(key for key in part.model_fields if key != "type"),
            "summary": part_summary(part),
        }
        for name, part in zip(sensor_names(), sensor_parts(), strict=True)
    ]


def _autopilots() -> list[Row]:
    return [
        {"name": each.name, "firmware": each.label, "from": ".".join(map(str, each.oldest_version))}
        for each in autopilot_strategies().values()
    ]


def _plugins() -> list[Row]:
    return [
        {
            "name": each.name,
            "origin": each.origin,
            "adds": "; ".join(
                f"{hook.replace('_', ' ')}: {', '.join(names)}" for hook, names in each.adds.items()
            ),
        }
        for each in installed_plugins_by_name()
    ]


def _oracle_text() -> str:
    lines: list[str] = []
    for _, spec in sorted(oracle_kinds().items()):
        doc = describe_oracles(spec)
        fast = "; lands at once when it fails" if doc.fail_fast else ""
        lines += [
            f"{doc.name}: {doc.summary} ({doc.window}{fast})",
            *_parameter_lines(doc.parameters),
        ]
    return "\n".join([*lines, "", "every oracle takes", *_parameter_lines(common_parameters())])


def _step_lines(doc: StepDoc) -> list[str]:
    """Return the listing of a recipe step with shapes, units and parameters."""
    works = ", ".join(doc.sensors) + (f" -> {doc.gives}" if doc.gives else "")
    texts = [each for each in (doc.details, doc.notes) if each]
    rows = [
        (f"    {each.name}", each.takes, "needed" if each.needed else each.default)
        for each in doc.parameters
    ]
    return [
        f"{doc.name} ({doc.stage}; {works}): {doc.summary}",
        *(line for text in texts for line in _wrap_lines(text)),
        *_align_columns(rows),
    ]


def _wrap_lines(text: str) -> list[str]:
    return wrap(text, _WIDTH, initial_indent="    ", subsequent_indent="    ")


def _parameter_lines(parameters: tuple[OracleParameterDoc, ...]) -> list[str]:
    return _align_columns(
        [
            (
                f"    {each.name}",
                f"{each.takes}{', ' if each.unit else ''}{each.unit}",
                "needed" if each.needed else each.default,
                each.meaning,
            )
            for each in parameters
        ]
    )


def _align_columns(rows: Sequence[tuple[str, ...]]) -> list[str]:
    if not rows:
        return []
    last = len(rows[0]) - 1
    widths = [max(len(row[column]) for row in rows) for column in range(last)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, (*widths, 0), strict=True)).rstrip()
        for row in rows
    ]


_LISTS: dict[What, Callable[[], list[Row]]] = {
    "campaigns": _campaigns,
    "operators": _operators,
    "autonomies": _autonomies,
    "oracles": _oracle_rows,
    "signals": _signals,
    "sensors": _sensors,
    "autopilots": _autopilots,
    "plugins": _plugins,
}
