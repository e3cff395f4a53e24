"""Differences between two manifests of a campaign, in words; pure."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from campaigns.setup.overrides import override_from_option

_MAX_LENGTH = 80
"""Of a value in a sentence about a changed key, in characters."""
_COUNTED = frozenset({"repetitions"})
"""Keys that only set the number of runs: missing runs are reported as never flown."""


def changed_keys(before: Any, now: Any, key: str = "") -> Iterator[tuple[str, str, str]]:
    """Yield the keys of a manifest's document that differ, with their values before and now."""
    if isinstance(before, dict) and isinstance(now, dict):
        for name in dict.fromkeys((*before, *now)):
            inner = f"{key}.{name}".lstrip(".")
            yield from changed_keys(before.get(name), now.get(name), inner)
    elif before != now:
        was, present = (json.dumps(one, ensure_ascii=False) for one in (before, now))
        yield key, was, present


def changes_since_flight(
    before: Mapping[str, Any], now: Mapping[str, Any], *, file: str
) -> list[str]:
    """Return in words what affects verdicts and has changed since a flight.

    before: the manifest of the flight. file: the campaign's file, compared key by key instead.
    """
    changes = [
        f"{key} was {_shorten(was)}, now it is {_shorten(present)}"
        for key, was, present in changed_keys(before.get("document", {}), now["document"])
        if key not in _COUNTED
    ]
    flown_files = before.get("files", {})
    changes += [
        f"{name} changed"
        for name, digest in now["files"].items()
        if name != file and flown_files.get(name, digest) != digest
    ]
    changes += _changed_options(before, now)
    was, present = (one.get("versions", {}).get("wil-campaign") for one in (before, now))
    if was != present:
        changes.append(f"wil-campaign was {was}, now it is {present}")
    return changes or _changed_runs(before, now)


def _changed_options(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return in words the --set options that only one manifest has and no document shows.

    These are options for the world or the recipe, and all options of a composed campaign.
    """
    was, present = (one.get("options", {}).get("set", []) for one in (before, now))
    changes = {text: "was not given" for text in present if text not in was}
    changes |= {text: "is not given" for text in was if text not in present}
    is_composed = "campaigns" in now["document"]
    return [
        f"--set {_shorten(text)} {what}"
        for text, what in changes.items()
        if is_composed or override_from_option("--set", text).file != "campaign"
    ]


def _changed_runs(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return in words the runs whose documents changed for any other reason."""
    flown = {run["run"]: run["documents"] for run in before.get("runs", [])}
    return [
        f"the files of {run['run']} changed"
        for run in now["runs"]
        if flown.get(run["run"], run["documents"]) != run["documents"]
    ]


def _shorten(text: str) -> str:
    """Return a text shortened to the maximum length."""
    return text if len(text) <= _MAX_LENGTH else f"{text[: _MAX_LENGTH - 3]}..."
