"""A campaign file for a confirmed failure, which `wil-campaign run` flies."""

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import yaml

from campaigns.schema import MATRIX_KEYS
from campaigns.search.model import FailingCase
from campaigns.search.search import failure_name
from campaigns.search.search_campaign import SearchCampaign
from worlds.files.documents import Data
from worlds.files.yaml_nodes import plain

FOLDER = "failures"
_LEFT_OUT = ("accept", "controls", "published", "retries")
_LONGEST_NAME = 64


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
    relocated = {key: _relocate_paths(value, home, folder) for key, value in campaign.items()}
    relocated["cases"] = {name: _case_overrides(search, case, folder)}
    text = yaml.safe_dump(relocated, sort_keys=False, allow_unicode=True, width=100)
    return _comment(case) + text


def _comment(case: FailingCase) -> str:
    """Return the comment above the file."""
    return (
        f"# Found by a search as {case.variant.name}; failed in {case.reduced_failed} of "
        f"{case.reduced_proven} flights in mode {case.mode} by {case.reduced_causes_text}.\n"
    )


def _case_overrides(search: SearchCampaign, case: FailingCase, folder: Path) -> dict[str, Data]:
    """Return the overrides of the failing case: the base case's, the options', the variant's."""
    overrides: dict[str, Data] = {}
    home = search.document.path.parent
    for override in (*search.case_overrides, *search.option_overrides):
        if override.dotted_key.partition(".")[0] not in MATRIX_KEYS:
            value = plain(override.entry.node)
            is_campaigns = override.file == "campaign"
            overrides[override.dotted_key] = (
                _relocate_paths(value, home, folder) if is_campaigns else value
            )
    changed: Mapping[str, Data] = search.overrides(case.reduced.values)
    return overrides | dict(changed)


def _relocate_paths(value: Data, home: Path, folder: Path) -> Data:
    """Return a value with file names relative to another folder than the campaign's."""
    if isinstance(value, dict):
        return {key: _relocate_paths(inner, home, folder) for key, inner in value.items()}
    if isinstance(value, list):
        return [_relocate_paths(inner, home, folder) for inner in value]
    if not isinstance(value, str) or "." not in value:
        return value
    name, colon, inside = value.rpartition(":") if ".py:" in value else (value, "", "")
    with suppress(OSError, ValueError):  # a text that is no path
        path = (home / name).resolve()
        if path.is_file():
            return f"{os.path.relpath(path, folder.resolve())}{colon}{inside}"
    return value
