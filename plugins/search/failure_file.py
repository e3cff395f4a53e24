"""A campaign file for a confirmed failure, which `wil-campaign run` flies."""

import os
from contextlib import suppress
from pathlib import Path

import yaml

from wil_campaign.campaigns.schema import matrix_keys
from wil_campaign.campaigns.setup.overrides import Override
from wil_campaign.plugins.search.exploration.model import FailingCase
from wil_campaign.plugins.search.exploration.search import failure_name
from wil_campaign.plugins.search.exploration.search_campaign import SearchCampaign, override_of
from wil_campaign.worlds.files.documents import Data
from wil_campaign.worlds.files.yaml_nodes import plain

FOLDER = "failures"
_LEFT_OUT = ("accept", "controls", "published", "retries")
_LONGEST_NAME = 64
_PATH_KEY = "build"
"""The key whose bare names are always paths; those of other keys may be names of other things."""


def failure_text(search: SearchCampaign, case: FailingCase, folder: Path) -> str:
    """Return the campaign file of a confirmed failure, as reduced. folder: of the new file.

    It has the search's seed, the case's name and as many repetitions as confirmed it, so that its
    flights are the same; all are required. Files that it names stay where they are.
    """
    name = failure_name(case.reduced)
    data = search.document.data
    campaign = dict(data) if isinstance(data, dict) else {}
    for key in _LEFT_OUT:
        campaign.pop(key, None)
    campaign["campaign"] = f"{search.campaign.name[: _LONGEST_NAME - len(name) - 1]}-{name}"
    cause = case.causes_text or "no cause is known"
    campaign["description"] = f"A failure that a search found: {cause}"
    campaign["modes"] = [case.mode]
    campaign["repetitions"] = search.part.confirm.flights
    campaign["seed"] = search.campaign.seed
    home = search.document.path.parent
    relocated = {
        key: _relocate_paths(value, home, folder, key=key) for key, value in campaign.items()
    }
    relocated["cases"] = {name: _case_overrides(search, case, folder)}
    text = yaml.safe_dump(relocated, sort_keys=False, allow_unicode=True, width=100)
    return _comment(case) + text


def _comment(case: FailingCase) -> str:
    return (
        f"# Found by a search as {case.variant.name}; failed in {case.reduced_failed} of "
        f"{case.reduced_proven} flights in mode {case.mode} by {case.reduced_causes_text}.\n"
    )


def _case_overrides(search: SearchCampaign, case: FailingCase, folder: Path) -> dict[str, Data]:
    """Return the overrides of the failing case: the base case's, the options', the variant's."""
    home = search.document.path.parent
    given = (*search.case_overrides, *search.option_overrides)
    changed = search.overrides(case.reduced.values).items()
    values: list[tuple[Override, Data]] = [(one, plain(one.entry.node)) for one in given]
    values += [(override_of(key, value), value) for key, value in changed]
    return {
        key: _relocate_paths(value, home, folder, key=key) if one.file == "campaign" else value
        for one, value in values
        if (key := one.dotted_key).partition(".")[0] not in matrix_keys()
    }


def _relocate_paths(value: Data, home: Path, folder: Path, *, key: str) -> Data:
    """Return a value with relative paths relative to another folder than the campaign's.

    key: of the value, dotted.
    """
    if isinstance(value, dict):
        return {
            name: _relocate_paths(inner, home, folder, key=name) for name, inner in value.items()
        }
    if isinstance(value, list):
        return [_relocate_paths(inner, home, folder, key=key) for inner in value]
    if not isinstance(value, str) or not _may_be_relative_path(value, key):
        return value
    name, colon, inside = value.rpartition(":") if ".py:" in value else (value, "", "")
    with suppress(OSError, ValueError):  # a text that is no path
        path = (home / name).resolve()
        if path.exists():
            return f"{os.path.relpath(path, folder.resolve())}{colon}{inside}"
    return value


def _may_be_relative_path(text: str, key: str) -> bool:
    """Return whether a text may be a relative path: `px4` names a folder in `build` alone."""
    if not text.strip("./"):
        return False  # as a separator; it names a folder everywhere
    is_bare = "." not in text and "/" not in text
    return not Path(text).is_absolute() and (not is_bare or key.rpartition(".")[2] == _PATH_KEY)
