"""Overrides of values in a case's files: by --set, by the case, by a control."""

from collections.abc import Iterable
from dataclasses import dataclass

from wil_campaign.campaigns.schema import matrix_keys
from wil_campaign.foundation.files.documents import (
    BadInput,
    Document,
    Path,
    Problem,
    YamlEntry,
    parse_option_value,
)

OVERRIDDEN_FILES = ("world", "recipe")
"""The files of a case that an override changes beside the campaign, by its first key."""


@dataclass(frozen=True, slots=True)
class Override:
    """An override of a value in a case's files: its dotted key, and the new entry."""

    dotted_key: str
    entry: YamlEntry

    @property
    def file(self) -> str:
        """Return which file of the case the override changes: "world", "recipe" or "campaign"."""
        head, dot, _ = self.dotted_key.partition(".")
        return head if dot and head in OVERRIDDEN_FILES else "campaign"

    @property
    def key_in_file(self) -> str:
        """Return the override's dotted key inside that file."""
        is_campaign = self.file == "campaign"
        return self.dotted_key if is_campaign else self.dotted_key.partition(".")[2]


def override_from_option(option: str, text: str) -> Override:
    """Return the override of an option such as `--set KEY=VALUE`. Raises BadInput."""
    name = f"{option} {text}"
    key, equals, value = text.partition("=")
    if not equals or not all(key.strip().split(".")):
        raise BadInput([Problem(name, 0, 0, "must be KEY=VALUE, like goal.altitude_m=1.5")])
    return Override(key.strip(), parse_option_value(value, name=name))


def overrides_of_case(file: Document, case: str) -> tuple[Override, ...]:
    """Return the overrides of a case. Raises BadInput for overrides of the matrix itself."""
    return overrides_at(file, ("cases", case))


def overrides_at(file: Document, path: Path) -> tuple[Override, ...]:
    """Return the overrides at a path of the campaign file. Raises BadInput like a case's."""
    given = file.get(path)
    value = file.entry(path).node.value if given is not None else None
    if not isinstance(value, dict):
        return ()
    found = tuple(Override(key, entry) for key, entry in value.items())
    problems = [
        override.entry.key.problem(f"'{override.dotted_key}' is the same for all cases")
        for override in found
        if override.dotted_key.partition(".")[0] in matrix_keys()
    ]
    if problems:
        raise BadInput(problems)
    return found


def apply_overrides(
    document: Document, overrides: Iterable[Override], problems: list[Problem]
) -> Document:
    """Return a document with its overrides applied; problems are collected."""
    for override in overrides:
        try:
            document = document.override(override.key_in_file, override.entry)
        except BadInput as error:
            problems += error.problems
    return document
