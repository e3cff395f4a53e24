"""`oracles`: each name with its parameters, checked by the oracle's own model."""

import re

from wil_campaign.foundation.files.documents import (
    BadInput,
    Document,
    Problem,
    YamlEntry,
    check_document,
    closest_word,
)
from wil_campaign.foundation.files.yaml_nodes import mapping_node
from wil_campaign.hooks import oracles
from wil_campaign.installed_plugins import absent_additions
from wil_campaign.safety.evaluation.judge import OracleUse
from wil_campaign.safety.model.verdict import PARTS
from wil_campaign.safety.oracles.registry import oracle_kinds, own_oracle_keys

_WORDS = re.compile("[./]")


def oracle_uses(file: Document) -> tuple[tuple[OracleUse, ...], list[Problem]]:
    """Return the oracles that a campaign uses with their parameters, and their problems.

    `name: {parameters}`; a name that is no kind of oracle gives its kind as `use`, or by a key of
    that kind alone (`stl`). A value that is no mapping is left to the schema's check.
    """
    oracle_kinds()  # a plugin that cannot be used is no problem of each oracle
    uses: list[OracleUse] = []
    problems: list[Problem] = []
    try:
        value = file.entry(("oracles",)).node.value
    except KeyError:
        return (), []
    for name, entry in value.items() if isinstance(value, dict) else ():
        if isinstance(entry.node.value, dict) or entry.node.value is None:
            try:
                uses.append(_use(file, name, entry))
            except BadInput as error:
                problems += error.problems
    return tuple(uses), problems


def _use(file: Document, name: str, entry: YamlEntry) -> OracleUse:
    if _WORDS.split(name)[0] in PARTS:
        message = f"'{name}' is the name of a part of a run, which decides verdicts itself; give "
        raise BadInput(
            [entry.key.problem(f"{message}the oracle another name, and its kind as `use`")]
        )
    value = entry.node.value if isinstance(entry.node.value, dict) else {}
    keys = {**dict.fromkeys(absent_additions(oracles)), **own_oracle_keys()}
    usual = next((keys[key] or key for key in keys if key in value), name)
    kind = value["use"].node.value if "use" in value else usual
    if not isinstance(kind, str) or kind not in oracle_kinds():
        place = value["use"].node.place if "use" in value else entry.key
        if why := absent_additions(oracles).get(str(kind)):
            raise BadInput([place.problem(why)])
        known = ", ".join(sorted(oracle_kinds()))
        meant = closest_word(str(kind), oracle_kinds())
        message = f"unknown oracle '{kind}'" + ("" if meant else f" (known: {known})")
        raise BadInput([place.problem(message, meant)])
    rest = {key: inner for key, inner in value.items() if key != "use"}
    parameters = Document(file.path, mapping_node(rest, entry.key))
    return OracleUse(name, kind, check_document(parameters, oracle_kinds()[kind].parameters))
