"""JSON Schemas for editors: up to date, true for every shipped file, false for mistakes in it."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from tests.test_house import ROOT
from wil_campaign.foundation.files.documents import load_document, parse_document
from wil_campaign.orchestrator.cli import main
from wil_campaign.plugins.start.json_schemas import SCHEMAS
from wil_campaign.recipes.model.registry import registered_steps
from wil_campaign.safety.oracles.registry import oracle_kinds

BUILT = Path("schemas")
SHIPPED = sorted(
    path
    for folder in ("campaigns", "campaigns/benches", "worlds", "recipes")
    for path in (ROOT / folder).glob("*.yaml")
)


@pytest.fixture(scope="module")
def schemas() -> dict[str, Any]:
    return {name.partition(".")[0]: make() for name, make in SCHEMAS.items()}


def kind_of(path: Path) -> str:
    schema = load_document(path).get(("schema",))
    assert isinstance(schema, str)
    return schema.split("/")[1]


def faults(schema: Any, text: str) -> list[str]:
    data = parse_document(text.encode(), name="a.yaml").data
    return [error.message for error in Draft202012Validator(schema).iter_errors(data)]


def test_the_command_writes_them_where_shipped_files_name_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Called at the top of the repository, which ignores that folder."""
    monkeypatch.chdir(tmp_path)
    assert main(["schema"]) == 0
    written = {path.name: json.loads(path.read_text("utf-8")) for path in BUILT.glob("*")}
    assert written == {name: make() for name, make in SCHEMAS.items()}
    assert capsys.readouterr().out.split() == [str(BUILT / name) for name in SCHEMAS]
    assert "/schemas/" in (ROOT / ".gitignore").read_text("utf-8").split()


def test_the_schemas_are_json_schemas(schemas: dict[str, Any]) -> None:
    for schema in schemas.values():
        assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
        Draft202012Validator.check_schema(schema)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_a_shipped_file_is_valid_and_names_its_schema(path: Path, schemas: dict[str, Any]) -> None:
    kind = kind_of(path)
    errors = list(Draft202012Validator(schemas[kind]).iter_errors(load_document(path).data))
    assert errors == []
    first, _, _ = path.read_text("utf-8").partition("\n")
    place = first.removeprefix("# yaml-language-server: $schema=")
    assert (path.parent / place).resolve() == ROOT / BUILT / f"{kind}.schema.json"


@pytest.mark.parametrize(
    ("kind", "old", "new"),
    [
        ("campaign", "autonomy:", "autonomie:"),
        ("campaign", "repetitions: 5", "repetitions: five"),
        ("campaign", "modes: [sim, wil]", "modes: [sim, will]"),
        ("campaign", "link: embedded", "lnik: embedded"),
        ("campaign", "time_limit: {limit_s: 40}", "time_limit: {limit: 40}"),
        ("campaign", "time_limit: {limit_s: 40}", "time: {limit_s: 40}"),
        ("world", "bar_m:", "bar_cm:"),
        ("world", "color: orange", "colour: orange"),
        ("recipe", "isolate_color: {name: orange}", "isolate_colour: {name: orange}"),
        ("recipe", "resize: {to: real}", "resize: {too: real}"),
        ("recipe", "publish: [real, twin]", "publish: [reel, twin]"),
    ],
)
def test_a_mistake_in_a_shipped_file_is_one_for_the_schema(
    schemas: dict[str, Any], kind: str, old: str, new: str
) -> None:
    text = (ROOT / f"{kind}s" / "gate.yaml").read_text("utf-8")
    assert old in text
    assert faults(schemas[kind], text) == []
    assert faults(schemas[kind], text.replace(old, new))


@pytest.mark.parametrize(
    "oracles",
    [
        "{low: {stl: 'always up_m < 2'}}",
        "{ends: {use: landed}}",
        "{landed: }",
        "{distance: {use: landed}}",
    ],
)
def test_oracles_with_an_own_name_are_valid(schemas: dict[str, Any], oracles: str) -> None:
    text = (ROOT / "campaigns" / "gate.yaml").read_text("utf-8")
    head, _, rest = text.partition("\noracles:\n")
    tail = rest[rest.index("\naccept:") :] if "\naccept:" in rest else ""
    assert faults(schemas["campaign"], f"{head}\noracles: {oracles}{tail}") == []


@pytest.mark.parametrize(
    ("short", "is_valid"),
    [("gate.py:Gate", True), ("{use: gate.py:Gate}", True), ("[gate.py]", False)],
)
def test_a_shorthand_is_valid(schemas: dict[str, Any], short: str, is_valid: bool) -> None:
    schema = {
        "$defs": schemas["campaign"]["$defs"],
        "properties": {"autonomy": {"$ref": "#/$defs/AutonomyPart"}},
    }
    assert (faults(schema, f"autonomy: {short}") == []) is is_valid


def test_every_oracle_and_step_is_completed(schemas: dict[str, Any]) -> None:
    oracles = schemas["campaign"]["$defs"]["CampaignPart"]["properties"]["oracles"]
    assert set(oracles["properties"]) == set(oracle_kinds())
    for kind in registered_steps():
        forms = schemas["recipe"]["$defs"][f"{kind.stage}_step"]["anyOf"]
        assert kind.name == "use" or kind.name in forms[1]["properties"]


def test_keys_carry_what_docstrings_say_of_them_and_their_unit(schemas: dict[str, Any]) -> None:
    models = schemas["campaign"]["$defs"]
    assert models["GeofencePart"]["properties"]["keep_m"] == {
        "default": 0.0,
        "description": "Distance that each keeps to the fence. Unit: metres.",
        "maximum": 1000,
        "minimum": 0,
        "title": "keep_m",
        "type": "number",
    }
    rate = models["WayPart"]["properties"]["bandwidth_kbit_s"]["description"]
    assert rate.endswith(" Unit: kilobits per second.")


def keys_of(schema: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield each key that a schema knows, with its place and its own schema."""
    if isinstance(schema, list):
        for index, one in enumerate(schema):
            yield from keys_of(one, f"{place}/{index}")
    elif isinstance(schema, dict):
        for name, one in schema.items():
            # A key of files may have the name, too.
            if name == "properties" and not place.endswith("/properties"):
                yield from ((f"{place}/{key}", value) for key, value in one.items())
            yield from keys_of(one, f"{place}/{name}")


@pytest.mark.parametrize("kind", ["campaign", "world", "recipe", "bench"])
def test_every_key_says_what_it_is(schemas: dict[str, Any], kind: str) -> None:
    keys = dict(keys_of(schemas[kind]))
    assert len(keys) > 30
    texts = {place: key.get("description", "") for place, key in keys.items()}
    assert [place for place, text in texts.items() if not text or text.startswith("Unit:")] == []


ON_BENCH = "  real:\n    start: {north_m: 0.5}\n    params: {MPC_XY_VEL_MAX: 2.0}\n  twin:"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("  twin:", ON_BENCH, ""),
        ("bench: hall-a", "bench: {properties: {indoor: true}}", ""),
        ("bench: hall-a\n", "", ""),  # then no vehicle is the bench's
        (
            "  twin:",
            ON_BENCH.replace("start", "link: embedded\n    start"),
            "is not valid under any",
        ),
        ("goal:", "geofence: {box: {}}\ngoal:", "'geofence' was unexpected"),
        ("bench: hall-a\nvehicles:\n  twin:", f"vehicles:\n{ON_BENCH}", "is not valid under any"),
    ],
)
def test_a_campaign_on_a_bench_omits_the_keys_of_every_bench_file(
    schemas: dict[str, Any], old: str, new: str, said: str
) -> None:
    text = (ROOT / "campaigns" / "benches" / "gate-hall.yaml").read_text("utf-8")
    assert old in text
    found = faults(schemas["campaign"], text.replace(old, new, 1))
    assert bool(found) is bool(said), found
    assert said in "".join(found)


def test_a_campaign_on_a_bench_may_leave_its_vehicles_out(schemas: dict[str, Any]) -> None:
    data = load_document(ROOT / "campaigns" / "benches" / "gate-hall.yaml").data
    assert isinstance(data, dict)
    alone = {key: value for key, value in data.items() if key != "vehicles"}
    validator = Draft202012Validator(schemas["campaign"])
    assert [error.message for error in validator.iter_errors(alone)] == []
    without = {key: value for key, value in alone.items() if key != "bench"}
    assert [error.message for error in validator.iter_errors(without)] != []
