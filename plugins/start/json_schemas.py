"""JSON Schemas of campaign, world, recipe and bench files, for completion and hover in editors.

They are made from the models that check the files (draft 2020-12), with the description of each key
from the docstrings. A schema checks one file alone; `wil-campaign validate` also checks names in
other files, and numbers against each other.
"""

import copy
import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import zip_longest
from typing import Any, TypeGuard, get_args

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaMode, models_json_schema
from pydantic_core import core_schema

from wil_campaign.campaigns.schema.bench import BenchPart
from wil_campaign.campaigns.schema.campaign import campaign_model
from wil_campaign.campaigns.schema.composition import CompositionPart
from wil_campaign.foundation.files.problems import unit_of_key
from wil_campaign.plugins.start.part_summaries import docstring_key_places, part_summary
from wil_campaign.recipes.language.recipe_document import CombinePart, RecipePart
from wil_campaign.recipes.model.registry import OWN_STEP, STAGES, Stage, registered_steps
from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.worlds.world_file.world_schema import WorldModel

DIALECT = GenerateJsonSchema.schema_dialect
Schema = dict[str, Any]

_UNITS = {
    "m": "metres",
    "m_s": "metres per second",
    "m_s2": "metres per second squared",
    "s": "seconds",
    "ms": "milliseconds",
    "deg": "degrees",
    "deg_s": "degrees per second",
    "rad": "radians",
    "rad_s": "radians per second",
    "hz": "hertz",
    "px": "pixels",
    "percent": "percent",
    "kbit_s": "kilobits per second",
    "v": "volts",
    "a": "amperes",
    "g": "g",
}
_MODE: JsonSchemaMode = "validation"
_SOME_BENCH: Schema = {"description": "The bench that is requested.", "not": {"type": "null"}}


def campaign_schema() -> Schema:
    """Return the schema of campaign files, those that name other campaigns included."""
    kinds, campaign = oracle_kinds().values(), campaign_model()
    parameters = tuple(dict.fromkeys(kind.parameters for kind in kinds))
    refs, definitions = _definitions(campaign, CompositionPart, *parameters)
    definitions["OwnOracle"] = _own_oracle()
    definitions["CampaignPart"]["properties"]["oracles"] = {
        "title": "oracles",
        "description": "The oracles that judge a run, by name, each with its parameters.",
        "type": "object",
        "minProperties": 1,
        "properties": {
            kind.name: {
                "description": f"{kind.summary}.",
                **_unless_named(refs[kind.parameters]),
            }
            for kind in kinds
        },
        "additionalProperties": {"$ref": "#/$defs/OwnOracle"},
    }
    _add_campaign_on_bench(definitions)
    return {
        "$schema": DIALECT,
        "title": "wil-campaign: campaign file",
        "description": part_summary(campaign),
        "type": "object",
        "if": {"required": ["campaigns"]},
        "then": refs[CompositionPart],
        "else": {
            "if": {"required": ["bench"], "properties": {"bench": _SOME_BENCH}},
            "then": {"$ref": "#/$defs/CampaignOnBench"},
            "else": refs[campaign],
        },
        "$defs": definitions,
    }


def _add_campaign_on_bench(definitions: Schema) -> None:
    """Add the campaign that asks for a bench, without the keys that a bench file defines."""
    campaign = _without_keys(definitions["CampaignPart"], "geofence", optional=("vehicles",))
    vehicles = copy.deepcopy(definitions["VehiclesPart"])
    vehicle = _without_keys(definitions["VehiclePart"], "link", "autopilot")
    definitions["VehicleOnBench"] = vehicle | {
        "description": "The real vehicle; its bench defines link and autopilot, and may add more."
    }
    of_bench = {"$ref": "#/$defs/VehicleOnBench"}
    vehicles["properties"]["real"]["anyOf"] = [of_bench, {"type": "null"}]
    definitions["VehiclesOnBench"] = vehicles
    campaign["properties"]["vehicles"]["$ref"] = "#/$defs/VehiclesOnBench"
    definitions["CampaignOnBench"] = campaign


def _without_keys(definition: Schema, *keys: str, optional: Sequence[str] = ()) -> Schema:
    """Return a copy of a definition without some keys. optional: those that become optional."""
    found = copy.deepcopy(definition)
    for key in keys:
        del found["properties"][key]
    required = [key for key in found.pop("required", []) if key not in {*keys, *optional}]
    return found | ({"required": required} if required else {})


def world_schema() -> Schema:
    """Return the schema of world files."""
    refs, definitions = _definitions(WorldModel)
    return {
        "$schema": DIALECT,
        "title": "wil-campaign: world file",
        **refs[WorldModel],
        "$defs": definitions,
    }


def recipe_schema() -> Schema:
    """Return the schema of recipe files with every step that is built in."""
    refs, definitions = _definitions(RecipePart, *{kind.parameters for kind in registered_steps()})
    keys = definitions[CombinePart.__name__]["properties"]
    for stage in STAGES:
        definitions[f"{stage}_step"] = _step(stage, refs)
        step = {"$ref": f"#/$defs/{stage}_step"}
        what = f"The steps of the stage {stage}, in order; each is a name or {{name: parameters}}."
        if stage == "merge":
            keys[stage] = {"title": stage, "description": "How the readings become one.", **step}
        else:
            keys[stage] |= {"description": what, "items": step}
    return {
        "$schema": DIALECT,
        "title": "wil-campaign: recipe file",
        **refs[RecipePart],
        "$defs": definitions,
    }


def bench_schema() -> Schema:
    """Return the schema of bench files."""
    refs, definitions = _definitions(BenchPart)
    return {
        "$schema": DIALECT,
        "title": "wil-campaign: bench file",
        **refs[BenchPart],
        "$defs": definitions,
    }


SCHEMAS: Mapping[str, Callable[[], Schema]] = {
    "campaign.schema.json": campaign_schema,
    "world.schema.json": world_schema,
    "recipe.schema.json": recipe_schema,
    "bench.schema.json": bench_schema,
}
"""The files of schemas, each with the function that makes it."""


def _definitions(*models: type[BaseModel]) -> tuple[dict[type[BaseModel], Schema], Schema]:
    wanted = [(model, _MODE) for model in models]
    found, whole = models_json_schema(wanted, by_alias=True, schema_generator=_Documented)
    return {model: found[model, _MODE] for model in models}, whole["$defs"]


class _Documented(GenerateJsonSchema):
    """Makes schemas in which each key is described by the model's docstring, with its unit."""

    def model_schema(self, schema: core_schema.ModelSchema) -> Schema:
        """Return the schema of a model; one with a shorthand takes the bare value as well."""
        made = super().model_schema(schema)
        model = schema["cls"]
        found = dict(_key_descriptions(model))
        for name, field in model.model_fields.items():
            key = field.alias or name
            if key in made.get("properties", {}):
                one = made["properties"][key]
                one["title"] = key
                text = one.get("description") or found.get(key) or found.get(name)
                if described := _with_unit(text or _part_summary(field.annotation), key):
                    one["description"] = described
        made["description"] = part_summary(model)
        made["title"] = re.sub(r"(Part|Model|Parameters)$", "", model.__name__)
        if key := getattr(model, "shorthand", ""):
            return {"title": made["title"], "anyOf": [made["properties"][key], made]}
        return made


def _part_summary(annotation: object) -> str:
    """Return the summary of the one model that a key's value is; "" for other values."""
    parts = [one for one in (annotation, *get_args(annotation)) if _is_model(one)]
    return part_summary(parts[0]) if len(parts) == 1 else ""


def _is_model(annotation: object) -> TypeGuard[type[BaseModel]]:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _key_descriptions(model: type[BaseModel]) -> Iterator[tuple[str, str]]:
    for one in reversed(model.__mro__):
        if not (issubclass(one, BaseModel) and one is not BaseModel):
            continue
        text = " ".join(inspect.cleandoc(one.__doc__ or "").split())
        places = list(docstring_key_places(model, text))
        for place, after in zip_longest(places, places[1:]):
            own = text[place.end() : None if after is None else after.start()].strip(" .;")
            for key in place[1].split(", "):
                yield key, own[:1].upper() + own[1:] + "."


def _with_unit(text: str, key: str) -> str:
    """Return a description with the unit that the key's name carries."""
    unit = _UNITS.get(unit_of_key(key), "")
    if not unit:
        return text
    return f"{text} Unit: {unit}.".strip()


def _unless_named(parameters: Schema) -> Schema:
    """Return the schema of an oracle: its parameters or nothing, or another kind by `use`."""
    return {
        "if": {"type": "object", "required": ["use"]},
        "then": {"$ref": "#/$defs/OwnOracle"},
        "else": {"anyOf": [parameters, {"type": "null"}]},
    }


def _own_oracle() -> Schema:
    keys = [kind.own_key for kind in oracle_kinds().values() if kind.own_key is not None]
    ways = "".join(f", or {own.noun} as `{own.key}`" for own in keys)
    use = {
        "title": "use",
        "description": "The kind of oracle; the other keys are its parameters.",
        "enum": sorted(oracle_kinds()),
    }
    given = {
        own.key: {"title": own.key, "description": own.summary, "type": "string"} for own in keys
    }
    return {
        "title": "oracle",
        "description": f"An oracle of your own name: its kind as `use`{ways}.",
        "type": "object",
        "properties": {"use": use, **given},
        "anyOf": [{"required": [key]} for key in ("use", *given)],
    }


def _step(stage: Stage, refs: Mapping[type[BaseModel], Schema]) -> Schema:
    """Return the schema of a step of one stage: a name, one mapping, or the user's own."""
    kinds = [kind for kind in registered_steps() if kind.stage == stage and kind.name != OWN_STEP]
    bare = [
        kind for kind in kinds if not any(map(_is_needed, kind.parameters.model_fields.values()))
    ]
    own = [kind for kind in registered_steps() if kind.stage == stage and kind.name == OWN_STEP]
    forms: list[Schema] = [
        {
            "type": "string",
            "oneOf": [{"const": kind.name, "description": kind.summary} for kind in bare],
        }
    ]
    forms.append(
        {
            "type": "object",
            "properties": {
                kind.name: {"description": kind.summary, **refs[kind.parameters]} for kind in kinds
            },
            "additionalProperties": False,
            "minProperties": 1,
            "maxProperties": 1,
        }
    )
    forms += [{"description": kind.summary, **refs[kind.parameters]} for kind in own]
    return {"title": f"{stage} step", "anyOf": forms}


def _is_needed(field: Any) -> bool:
    return bool(field.is_required())
