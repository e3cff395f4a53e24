"""Taking up a campaign that was cut off: what it was, what is finished, what has to be flown."""

import json
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from campaigns.expansion.expansion import Campaign, RunPlan
from orchestrator.campaign.campaign_folder import (
    OutputError,
    TakenError,
    earlier_folders,
    held,
    newest_folder,
    set_aside,
)
from orchestrator.campaign.manifest_changes import changed_keys
from orchestrator.model.attempts import attempt_of, retry_due
from orchestrator.model.document_writer import to_json
from orchestrator.model.results import Attempt, RunResult
from orchestrator.model.results_reader import ResultError, read_result

_LANDED_S = 120.0
"""How long a run of a campaign that was killed may go on: it lands, for its parent has died."""
_LOOK_S = 0.2
_CUT_OFF = "it has no result"

Say = Callable[[str], None]


class ResumeError(Exception):
    """A campaign that cannot be resumed; says why, and what to do."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ResumedCampaign:
    """What a resumed campaign has already, by run. attempts: at those still to be flown."""

    results: Mapping[str, RunResult]
    attempts: Mapping[str, tuple[Attempt, ...]]


def resumed_folder(out: Path, campaign: str) -> Path:
    """Return the folder to resume: `out` itself, or the campaign's newest beneath it.

    Raises ResumeError when there is none.
    """
    if (out / "campaign.json").is_file():
        return out
    newest = newest_folder(out / campaign)
    if newest is None:
        raise ResumeError(
            f"there is nothing to resume: no campaign.json in {out}, nor beneath {out / campaign}; "
            "name the folder by --out"
        )
    return newest


def resumed_manifest(folder: Path, now: Mapping[str, object]) -> Mapping[str, object]:
    """Return the manifest of a resumed folder with the resumption added; now: today's.

    Raises ResumeError when they differ: two campaigns in one folder prove nothing.
    """
    path = folder / "campaign.json"
    try:
        before = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise ResumeError(f"{path} cannot be read: {error}") from error
    present = json.loads(to_json(now))
    if not isinstance(before, dict) or not before.keys() >= present.keys():
        raise ResumeError(
            f"{path} was written by another version: start the campaign again without --resume"
        )
    if said := list(_differences(before, present)):
        raise ResumeError(
            f"{folder} cannot be resumed: {'; '.join(said)}. Results of two campaigns do not make "
            "one: bring back what was, or begin anew without --resume"
        )
    again = [*before.get("resumed_utc", []), present["started_utc"]]
    return {**before, "resumed_utc": again}


def resume_campaign(
    campaign: Campaign, folder: Path, *, retries: int, may_repeat: bool, say: Say
) -> ResumedCampaign:
    """Return the finished runs of a resumed campaign, and set the others aside.

    retries: of the campaign. may_repeat: whether a run that came to an end without proving
    anything is flown again: never with hardware. Raises OutputError, OSError.
    """
    results: dict[str, RunResult] = {}
    attempts: dict[str, tuple[Attempt, ...]] = {}
    for plan in campaign.plans:
        home = folder / plan.name
        if home.is_dir():
            _wait_for(home, say)
        earlier = [_attempt(folder, place) for place in earlier_folders(folder, plan.name)]
        found = _find_results(home, plan)
        if isinstance(found, RunResult) and not (
            may_repeat and _needs_another_flight(found, retries)
        ):
            results[plan.name] = found
            continue
        if found:
            place = set_aside(folder, plan.name).relative_to(folder)
            last = (
                Attempt(None, found, str(place))
                if isinstance(found, str)
                else attempt_of(found, str(place))
            )
            say(f"{plan.name}: {last.verdict or 'cut off'}, {last.reason}; kept in {place}")
            earlier.append(last)
        attempts[plan.name] = tuple(earlier)
    return ResumedCampaign(results=results, attempts=attempts)


def _needs_another_flight(result: RunResult, retries: int) -> bool:
    """Return whether a result of the resumed campaign has to be flown again."""
    # Whose parent died, or whose operator pressed Ctrl-C, was not tried to its end.
    return result.verdict == "ABORTED" or retry_due(result, retries=retries)


def _find_results(home: Path, plan: RunPlan) -> RunResult | str:
    """Return a run's result to resume with; or in words why it is unusable; "" for none."""
    if not home.is_dir() or not any(home.iterdir()):
        return ""
    if not (home / "result.json").exists():
        return _CUT_OFF
    try:
        result = read_result(home / "result.json")
    except ResultError as error:
        return str(error)
    wanted = (plan.case, plan.mode, plan.repetition, plan.seed, plan.required)
    if (result.case, result.mode, result.rep, result.seed, result.required) != wanted:
        return f"{home / 'result.json'} is of another run"
    return result


def _attempt(folder: Path, place: Path) -> Attempt:
    """Return the earlier attempt in a folder that the resumption sets aside."""
    name = str(place.relative_to(folder))
    try:
        return attempt_of(read_result(place / "result.json"), name)
    except ResultError:
        return Attempt(None, _CUT_OFF, name)


def _wait_for(home: Path, say: Say) -> None:
    """Wait until no process flies into the folder to resume. Raises OutputError."""
    told = False
    for _ in range(round(_LANDED_S / _LOOK_S)):
        try:
            with held(home):
                return
        except TakenError:
            if not told:
                say(f"{home} is still in flight: waiting until it has landed")
                told = True
            time.sleep(_LOOK_S)
    raise OutputError(
        f"{home} is being flown still, after {_LANDED_S:g} s; look: wil-campaign watch"
    )


def _differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield differences of the manifests that forbid resuming: name, clock, seed, options."""
    for key, word in (("campaign", "its name"), ("clock", "its clock"), ("seed", "its seed")):
        if before[key] != now[key]:
            yield f"{word} was {before[key]}, and is {now[key]}"
    if not before["arm"]:
        yield "it armed nothing (--no-arm)"
    files = list(_changes(before["files"], now["files"]))
    yield from (f"{name} {what}" for name, _, _, what in files)
    for name, was, present, _ in _changes(before["versions"], now["versions"]):
        yield f"{name} was {was}, and is {present}"
    if before["document"] != now["document"] and not files:
        for key, was, present in changed_keys(before["document"], now["document"]):
            yield f"{key} was {was}, and is {present} (an option, or --set {key}=...)"
    elif before["runs"] != now["runs"] and not files:
        yield from _different_runs(before, now)


def _different_runs(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield the resumption's options that select other runs, or override other files."""
    was, present = before.get("options", {}), now.get("options", {})
    said = [
        f"--{name} was {_shown(was.get(name))}, and is {_shown(present.get(name))}"
        for name in present
        if was.get(name) != present.get(name)
    ]
    yield from said or [f"it had {len(before['runs'])} runs, and has {len(now['runs'])}, or others"]


def _shown(values: object) -> str:
    """Return an option's values as a resumption message shows them."""
    return " and ".join(map(str, values)) if isinstance(values, list) and values else "not given"


def _changes(
    before: Mapping[str, str], now: Mapping[str, str]
) -> Iterator[tuple[str, str | None, str | None, str]]:
    """Yield the files that changed since the resumed campaign was flown."""
    for name in sorted({*before, *now}):
        was, present = before.get(name), now.get(name)
        if was != present:
            what = "was not there" if was is None else "is gone" if present is None else "changed"
            yield name, was, present, what
