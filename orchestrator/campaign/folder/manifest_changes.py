"""Differences between two manifests of a campaign, in words; pure."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from wil_campaign.campaigns.setup.overrides import override_from_option
from wil_campaign.orchestrator.campaign.folder.manifest import manifest_run_values

_MAX_LENGTH = 80
"""Of a value in a sentence about a changed key, in characters."""
_MISSING: Any = object()
"""The value of a key that a document does not have."""
_COUNTED = frozenset({"repetitions"})
"""Keys that only set the number of runs: missing runs are reported as never flown.

Not so where one of both is a sequential test, a mapping.
"""
_KINDS = {"document": dict, "files": dict, "options": dict, "versions": dict, "runs": list}
"""The keys of a manifest that are compared, each with the kind of its value."""


def damaged_manifest_keys(manifest: Mapping[str, Any]) -> list[str]:
    """Return the keys of a manifest whose values are of a kind that no version writes."""
    damaged = [
        key for key, kind in _KINDS.items() if not isinstance(manifest.get(key, kind()), kind)
    ]
    options = manifest.get("options", {})
    given = options.get("set", []) if isinstance(options, dict) else []
    if not isinstance(given, list) or not all(isinstance(text, str) for text in given):
        damaged.append("options.set")
    return damaged


def changed_manifest_keys(before: Any, now: Any, key: str = "") -> Iterator[tuple[str, str, str]]:
    """Yield the keys of a manifest's document that differ, with their values before and now.

    A missing one counts as null, but differs from it: null in a case takes away what the campaign
    has.
    """
    if isinstance(before, dict) and isinstance(now, dict):
        for name in dict.fromkeys((*before, *now)):
            inner = f"{key}.{name}".lstrip(".")
            yield from changed_manifest_keys(
                before.get(name, _MISSING), now.get(name, _MISSING), inner
            )
    elif before != now:
        yield key, _value_text(before, beside=now), _value_text(now, beside=before)


def _value_text(value: Any, *, beside: Any) -> str:
    """Return a value in words. beside: the other one, from which a missing one differs if null."""
    if value is _MISSING and beside is None:
        return "not set"
    return json.dumps(None if value is _MISSING else value, ensure_ascii=False)


def changes_since_flight(
    before: Mapping[str, Any], now: Mapping[str, Any], *, file: str
) -> list[str]:
    """Return in words what affects verdicts and has changed since a flight.

    before: the manifest of the flight. file: the campaign's file, compared key by key instead.
    """
    changes = [
        f"{key} was {shortened_text(was)}, now it is {shortened_text(present)}"
        for key, was, present in changed_manifest_keys(before.get("document", {}), now["document"])
        if key not in _COUNTED or any(text.startswith("{") for text in (was, present))
    ]
    flown_files = before.get("files", {})
    changes += [
        f"{name} changed"
        for name, digest in now["files"].items()
        if name != file and flown_files.get(name, digest) != digest
    ]
    changes += changed_options(before, now)
    was, present = (one.get("versions", {}).get("wil-campaign") for one in (before, now))
    if was != present:
        changes.append(f"wil-campaign was {was}, now it is {present}")
    changes += changed_plugins(before, now)
    return changes or _changed_runs(before, now)


def changed_plugins(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return in words the plugins of others that differ between two manifests.

    Of a manifest of an earlier version, which names none, nothing is known.
    """
    was, present = before.get("plugins"), now.get("plugins")
    if not isinstance(was, dict) or not isinstance(present, dict):
        return []
    return [
        f"the plugin {name} was {was.get(name, 'not there')}, now it is "
        f"{present.get(name, 'not there')}"
        for name in sorted({*was, *present})
        if was.get(name) != present.get(name)
    ]


def changed_options(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return in words the --set options that only one manifest has and no document shows.

    These are options for the world or the recipe, and all options of a composed campaign.
    """
    was, present = (one.get("options", {}).get("set", []) for one in (before, now))
    changes = {text: "was not given" for text in present if text not in was}
    changes |= {text: "is not given" for text in was if text not in present}
    is_composed = "campaigns" in now["document"]
    return [
        f"--set {shortened_text(text)} {what}"
        for text, what in changes.items()
        if is_composed or override_from_option("--set", text).file != "campaign"
    ]


def _changed_runs(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return in words the runs whose documents changed for any other reason.

    Those of a run whose entry was damaged count as changed; a run that was not flown has none.
    """
    named, flown = manifest_run_values(before, "run"), manifest_run_values(before, "documents")
    return [
        f"the files of {run['run']} changed"
        for run in now["runs"]
        if run["run"] in named and flown.get(run["run"]) != run["documents"]
    ]


def shortened_text(text: str) -> str:
    """Return a text shortened to the maximum length."""
    return text if len(text) <= _MAX_LENGTH else f"{text[: _MAX_LENGTH - 3]}..."
