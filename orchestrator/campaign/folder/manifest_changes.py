"""What a campaign's manifest says otherwise than an earlier one; pure."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from campaigns.setup.case_files import override_from_option

_LONGEST = 80
"""Characters of a value in a sentence about a changed key."""
_COUNTED = frozenset({"repetitions"})
"""Keys that only say how many runs there are: what is missing of them is named as never flown."""


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
    """Return in words what judges a campaign otherwise than the manifest that it was flown by.

    file: the campaign's own, of which each key is compared.
    """
    said = [
        f"{key} was {_cut(was)}, and is {_cut(present)}"
        for key, was, present in changed_keys(before.get("document", {}), now["document"])
        if key not in _COUNTED
    ]
    flown_files = before.get("files", {})
    said += [
        f"{name} changed"
        for name, digest in now["files"].items()
        if name != file and flown_files.get(name, digest) != digest
    ]
    said += _changed_options(before, now)
    was, present = (one.get("versions", {}).get("wil-campaign") for one in (before, now))
    if was != present:
        said.append(f"wil-campaign was {was}, and is {present}")
    return said or _changed_runs(before, now)


def _changed_options(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return the --set options of one manifest alone whose keys are not in its document.

    Those of the world or the recipe, and all of a campaign that names others.
    """
    was, present = (one.get("options", {}).get("set", []) for one in (before, now))
    said = {text: "was not given" for text in present if text not in was}
    said |= {text: "is not given" for text in was if text not in present}
    is_composed = "campaigns" in now["document"]
    return [
        f"--set {_cut(text)} {what}"
        for text, what in said.items()
        if is_composed or override_from_option("--set", text).file != "campaign"
    ]


def _changed_runs(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return the runs whose documents the manifest has otherwise, for a reason not found above."""
    flown = {run["run"]: run["documents"] for run in before.get("runs", [])}
    return [
        f"the files of {run['run']} changed"
        for run in now["runs"]
        if flown.get(run["run"], run["documents"]) != run["documents"]
    ]


def _cut(text: str) -> str:
    """Return a value as short as a sentence about the manifest's changes takes it."""
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."
