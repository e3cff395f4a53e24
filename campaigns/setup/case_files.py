"""The files of one case: campaign, world and recipe, with what the case and --set override."""

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from wil_campaign.campaigns.setup.overrides import OVERRIDDEN_FILES, Override, apply_overrides
from wil_campaign.foundation.files.documents import (
    BadInput,
    Data,
    Document,
    Problem,
    closest_word,
    load_document,
    parse_option_value,
)
from wil_campaign.foundation.files.documents import Path as DocumentPath
from wil_campaign.foundation.files.paths import is_file, is_folder, path_exists
from wil_campaign.recipes.language.recipe_files import load_recipe_document
from wil_campaign.safety.fence.fence_files import load_fence_file

_SUFFIXES = frozenset({".yaml", ".yml", ".plan", ".waypoints", ".json", ".geojson", ".xml"})
"""Of files that a campaign may name."""


@dataclass(frozen=True, slots=True)
class CaseFiles:
    """The documents of one case, overrides applied; picklable. recipe: None without one.

    fences: the files that the geofence names, by what the campaign calls them.
    """

    campaign: Document
    world: Document | None
    recipe: Document | None
    fences: Mapping[str, Document] = field(default_factory=dict)

    @property
    def of_case(self) -> Document:
        """Return the campaign's document without what it says of its cases."""
        return self.campaign.without(("cases", "controls", "published"))

    def alone(self, case: str) -> "CaseFiles":
        """Return the files without what the campaign says of other cases and controls.

        Of thousands of cases each run would have all in its recording.
        """
        rest = self.campaign.without(("published",))
        own = rest.with_entries(("cases", "controls"), names_in_own_file(case))
        return replace(self, campaign=own)

    @property
    def folder(self) -> Path:
        """Return the folder to which file names of the case are relative."""
        return self.campaign.path.parent

    def seeded(self, seed: int) -> "CaseFiles":
        """Return the files for a run: its seed in a world that draws speeds and has none itself."""
        if self.world is None or self.world.get(("seed",)) is not None:
            return self
        if not _draws_speeds(self.world.get(("objects",))):
            return self
        entry = parse_option_value(str(seed), name="the run's seed")
        return replace(self, world=self.world.override("seed", entry))

    @property
    def paths(self) -> tuple[Path, ...]:
        """Return the paths of the case's files."""
        documents = (self.campaign, self.world, self.recipe, *self.fences.values())
        return tuple(document.path for document in documents if document is not None)


def names_in_own_file(case: str) -> tuple[str, ...]:
    """Return the names that a case or control may have in its file, the longest first.

    A composition puts the name of a part and a dot before it.
    """
    parts = case.split(".")
    return tuple(".".join(parts[start:]) for start in range(len(parts)))


def _draws_speeds(objects: Data) -> bool:
    """Return whether an object of a case's world moves at a speed that is drawn."""
    motions = [
        one.get("motion")
        for one in (objects if isinstance(objects, dict) else {}).values()
        if isinstance(one, dict)
    ]
    return any(isinstance(motion, dict) and motion.get("speed_sd_m_s") for motion in motions)


def case_files(
    file: Document,
    overrides: Iterable[Override],
    complete: Callable[[Document], Document] = lambda document: document,
) -> tuple[CaseFiles, list[Problem]]:
    """Return the files of a case, and the problems of the files or the overrides.

    A file that is missing or unreadable is None. Later overrides win. complete: adds what the
    overridden campaign takes from its bench; raises BadInput.
    """
    problems: list[Problem] = []
    ordered = tuple(overrides)
    file = apply_overrides(file, (o for o in ordered if o.file == "campaign"), problems)
    try:
        file = complete(file)
    except BadInput as error:
        problems += error.problems
    found: dict[str, Document | None] = {}
    for key in OVERRIDDEN_FILES:
        inner = [override for override in ordered if override.file == key]
        document = _named_file(file, (key,), problems)
        if document is not None:
            document = apply_overrides(document, inner, problems)
        elif file.get((key,)) is None:
            problems += [
                override.entry.key.problem(f"'{override.dotted_key}': the campaign has no {key}")
                for override in inner
            ]
        found[key] = document
    fences = fence_files(file, problems)
    return CaseFiles(file, found["world"], found["recipe"], fences), problems


def fence_files(file: Document, problems: list[Problem]) -> dict[str, Document]:
    """Return the files that a geofence names, by their names there; problems are collected."""
    found: dict[str, Document] = {}
    for place in (("geofence",), ("geofence", "real"), ("geofence", "twin")):
        document = _named_file(file, (*place, "file"), problems, is_fence=True)
        if document is not None:
            found[str(file.get((*place, "file")))] = document
    return found


def _named_file(
    file: Document, key: DocumentPath, problems: list[Problem], *, is_fence: bool = False
) -> Document | None:
    """Return the case's file named at a path of the campaign; None without one."""
    text = file.get(key)
    if not isinstance(text, str):
        return None
    path = file.path.parent / text
    if not path_exists(path):
        message = f"there is no file '{text}' beside the campaign"
        problems.append(file.problem(key, message, _sibling(text, path)))
        return None
    if not is_file(path):
        problems.append(file.problem(key, f"'{text}' beside the campaign is no file"))
        return None
    name = os.path.normpath(Path(file.name).parent / text)
    try:
        if key == ("recipe",):
            return load_recipe_document(path, name)
        return load_fence_file(path, name) if is_fence else load_document(path, name=name)
    except BadInput as error:
        problems += error.problems
        return None


def _sibling(text: str, path: Path) -> str:
    """Return the name of a file like the missing one, relative to the campaign; "" for none."""
    if not is_folder(path.parent):
        return ""
    try:
        others = [other.name for other in path.parent.iterdir() if other.suffix in _SUFFIXES]
    except OSError:  # it may be entered, and not listed
        return ""
    found = closest_word(path.name, others)
    return str(Path(text).parent / found) if found else ""
