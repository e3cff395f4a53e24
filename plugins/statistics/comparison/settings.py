"""Differences in the settings of two campaigns, by their manifests: of the test and its subject.

Passes under weaker limits, with fewer controls or in another world are no passes of the same test.
The autonomy (but its limits), code and networks of files, and the version of this program are what
a comparison is for: they are named, and do not count.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

from wil_campaign.orchestrator.campaign.folder.manifest_changes import (
    changed_manifest_keys,
    changed_options,
    changed_plugins,
    shortened_text,
)
from wil_campaign.orchestrator.run_results.result_parts import distinct_firmware, firmware_changes
from wil_campaign.orchestrator.run_results.run_result import RunResult

_NO_SETTINGS = frozenset(
    {
        "description",
        "repetitions",
        "seed",
        "published",
        "operator",
        "record",
        "campaign",
        "observer",
    }
)
"""Keys of a campaign file that do not change what its flights show."""
_ADDABLE = frozenset({"oracles", "cases", "controls"})
"""Keys of which a further entry judges more: it is named, and does not count."""
_CODE = frozenset({".py", ".onnx", ".so"})


@dataclass(frozen=True, slots=True)
class SettingsChanges:
    """What differs, in words. removed: of the test, and is gone; changed: of the test otherwise.

    named: what does not count: the subject, and what the test has in addition.
    """

    removed: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    named: tuple[str, ...] = ()

    def __add__(self, other: "SettingsChanges") -> "SettingsChanges":
        """Return the changes of both."""
        return SettingsChanges(
            (*self.removed, *other.removed),
            (*self.changed, *other.changed),
            (*self.named, *other.named),
        )


def manifest_settings(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return what of a manifest are settings of its test: equal for campaigns that compare."""
    options = _mapping(manifest, "options")
    return {
        "document": {
            key: value
            for key, value in _mapping(manifest, "document").items()
            if key not in {*_NO_SETTINGS, "autonomy"}
        },
        "files": {
            name: digest
            for name, digest in _mapping(manifest, "files").items()
            if name != manifest.get("file") and PurePath(name).suffix not in _CODE
        },
        "limits": _mapping(_mapping(_mapping(manifest, "document"), "autonomy"), "limits"),
        "set": options.get("set", []),
        "clock": manifest.get("clock"),
    }


def settings_changes(
    before: Mapping[str, Mapping[str, Any]], now: Mapping[str, Any]
) -> SettingsChanges:
    """Return how the settings of campaigns before differ from those now. before: by folder name."""
    found: dict[str, dict[str, None]] = {"removed": {}, "changed": {}, "named": {}}
    for folder, manifest in before.items():
        for kind, text in _differences(manifest, now):
            found[kind][f"{folder}: {text}" if len(before) > 1 else text] = None
    return SettingsChanges(**{kind: tuple(texts) for kind, texts in found.items()})


def firmware_changes_since(
    before: Mapping[str, Iterable[RunResult]], now: Iterable[RunResult]
) -> SettingsChanges:
    """Return how the firmware that flew before differs from that of now. before: by folder name.

    Another version, board or frame is another test; other parameters and another board of the kind
    are named. Of vehicles without a record, as in results of earlier versions, nothing is known.
    """
    changed: dict[str, None] = {}
    named: dict[str, None] = {}
    flown_now = {
        flown_firmware.vehicle: flown_firmware for run in now for flown_firmware in run.firmware
    }
    for folder, runs in before.items():
        place = f"{folder}: " if len(before) > 1 else ""
        for was in distinct_firmware(
            flown_firmware for run in runs for flown_firmware in run.firmware
        ):
            if (present := flown_now.get(was.vehicle)) is None:
                continue
            kind, unit = firmware_changes(was, present)
            changed |= {f"{place}{kind}": None} if kind else {}
            named |= {f"{place}{unit}": None} if unit else {}
    return SettingsChanges(changed=tuple(changed), named=tuple(named))


def _differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the kind and the text of each difference between two manifests."""
    old, new = (_mapping(one, "document") for one in (before, now))
    for key, was, present in changed_manifest_keys(old, new):
        names = key.split(".")
        if names[0] not in _NO_SETTINGS:
            text = f"{key} was {shortened_text(was)}, now it is {shortened_text(present)}"
            yield _kind(names, is_added=was == "null", is_removed=present == "null"), text
    yield from _file_differences(before, now)
    for text in changed_options(before, {**now, "document": new}):
        yield "changed", text
    if before.get("clock") != now.get("clock"):
        yield "changed", f"the clock was {before.get('clock')}, now it is {now.get('clock')}"
    versions = [_mapping(one, "versions").get("wil-campaign") for one in (before, now)]
    if versions[0] != versions[1]:
        yield "named", f"wil-campaign was {versions[0]}, now it is {versions[1]}"
    for text in changed_plugins(before, now):
        yield "named", text


def _kind(names: list[str], *, is_added: bool, is_removed: bool) -> str:
    """Return which kind of difference a key of the document is."""
    own = names[2:] if names[0] == "cases" else names
    if own[:1] == ["autonomy"] and own[1:2] != ["limits"]:
        return "named"
    if is_removed:
        return "removed"
    is_entry = len(names) == 2 and names[0] in _ADDABLE
    return "named" if is_added and is_entry else "changed"


def _file_differences(
    before: Mapping[str, Any], now: Mapping[str, Any]
) -> Iterator[tuple[str, str]]:
    """Yield the differences of files read, without the campaign's own, compared key by key."""
    old, new = (_mapping(one, "files") for one in (before, now))
    own = {now.get("file"), before.get("file")}
    for name in _all_names(old, new):
        if name in own or old.get(name) == new.get(name):
            continue
        kind = "named" if PurePath(name).suffix in _CODE else "changed"
        how = "changed" if name in old and name in new else "is read now"
        yield kind, f"{name} {how if name in new else 'is not read any more'}"


def _all_names(*files: Iterable[str]) -> Iterator[str]:
    yield from dict.fromkeys(name for each in files for name in each)


def _mapping(manifest: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """Return a mapping of a manifest; empty where it is missing or damaged."""
    found = manifest.get(key)
    return found if isinstance(found, dict) else {}
