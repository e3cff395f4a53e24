"""Finds the folder of a campaign to resume, and checks that the campaign is unchanged."""

import json
import re
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.foundation.files.limited_json import read_limited_json
from wil_campaign.orchestrator.campaign.folder.campaign_folder import newest_campaign_folder
from wil_campaign.orchestrator.campaign.folder.manifest_changes import (
    changed_manifest_keys,
    changed_plugins,
    damaged_manifest_keys,
)
from wil_campaign.orchestrator.recording.timestamps import folder_stamp

_STAMP = re.compile(r"\d{8}T\d{6}Z")
"""The name of a campaign's folder begins with it."""


class ResumeError(Exception):
    """A campaign cannot be resumed; says why, and the remedy."""


def resumed_folder(out: Path, campaign: str) -> Path:
    """Return the folder to resume: `out` itself, or the campaign's newest beneath it.

    Raises ResumeError when there is none, and when its name has a time that is still to come: the
    clock was set back, and an older name may be the one that was interrupted.
    """
    if (out / "campaign.json").is_file():
        return out
    newest = newest_campaign_folder(out / campaign)
    if newest is None:
        raise ResumeError(
            f"there is nothing to resume: no campaign.json in {out}, nor beneath {out / campaign}; "
            "name the folder by --out"
        )
    if (named := _STAMP.match(newest.name)) and named[0] > folder_stamp(time.time()):
        raise ResumeError(
            f"{newest} has a time that is still to come: the clock of this machine was set back, "
            "and the newest folder is not known; name the one to resume by --out"
        )
    return newest


def resumed_manifest(folder: Path, now: Mapping[str, object]) -> Mapping[str, object]:
    """Return the manifest of a resumed folder with the time of resuming; now: the current manifest.

    Raises ResumeError when they differ: results of two campaigns must not be mixed.
    """
    path = folder / "campaign.json"
    try:
        before = read_limited_json(path)
    except (OSError, ValueError) as error:
        raise ResumeError(f"{path} cannot be read: {error}") from error
    present = json.loads(to_json(now))
    if not isinstance(before, dict) or not before.keys() >= present.keys():
        raise ResumeError(
            f"{path} was written by another version: start the campaign anew, without --resume"
        )
    if damaged := damaged_manifest_keys(before):
        raise ResumeError(
            f"{path} is damaged at {', '.join(damaged)}: restore it, or start the campaign anew, "
            "without --resume"
        )
    if differences := list(_differences(before, present)):
        raise ResumeError(
            f"{folder} cannot be resumed: {'; '.join(differences)}. Results of two different "
            "campaigns must not be mixed: undo these changes, or start anew without --resume"
        )
    again = [*before.get("resumed_utc", []), present["started_utc"]]
    return {**before, "resumed_utc": again}


def _differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield differences of the manifests that forbid resuming: name, clock, seed, options."""
    for key, word in (("campaign", "its name"), ("clock", "its clock"), ("seed", "its seed")):
        if before[key] != now[key]:
            yield f"{word} was {before[key]}, now it is {now[key]}"
    if not before["arm"]:
        yield "it was flown without arming (--no-arm)"
    files = list(_changes(before["files"], now["files"]))
    yield from (f"{name} {what}" for name, _, _, what in files)
    for name, was, present, _ in _changes(before["versions"], now["versions"]):
        yield f"{name} was {was}, now it is {present}"
    yield from changed_plugins(before, now)
    if before["document"] != now["document"] and not files:
        for key, was, present in changed_manifest_keys(before["document"], now["document"]):
            yield f"{key} was {was}, now it is {present} (an option, or --set {key}=...)"
    elif before["runs"] != now["runs"] and not files:
        yield from _different_runs(before, now)


def _different_runs(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield the options that now select other runs, or override other files."""
    was, present = before.get("options", {}), now.get("options", {})
    changes = [
        f"--{name} was {_values_text(was.get(name))}, now it is {_values_text(present.get(name))}"
        for name in present
        if was.get(name) != present.get(name)
    ]
    counts = f"the selected runs differ: {len(before['runs'])} before, {len(now['runs'])} now"
    yield from changes or [counts]


def _values_text(values: object) -> str:
    return " and ".join(map(str, values)) if isinstance(values, list) and values else "not given"


def _changes(
    before: Mapping[str, str], now: Mapping[str, str]
) -> Iterator[tuple[str, str | None, str | None, str]]:
    """Yield the names whose values changed, with both values and what happened."""
    for name in sorted({*before, *now}):
        was, present = before.get(name), now.get(name)
        if was != present:
            what = "is new" if was is None else "is missing" if present is None else "changed"
            yield name, was, present, what
