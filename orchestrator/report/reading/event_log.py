"""Reads log.jsonl into events with readable texts; counts damaged lines."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

from wil_campaign.foundation.files.limited_json import loads_limited_json
from wil_campaign.orchestrator.reading.results_folder import UnreadableError, read_limited_data
from wil_campaign.orchestrator.report.model import LogEvent

MOST_EVENTS = 400
"""Events shown of a run; a vehicle that repeats a message would hide the rest."""
_OWN_LIMIT = frozenset({"decisive", "flag", "stage"})
"""Kinds of which as many more are shown: the verdict and its time rest on them."""


@dataclass(frozen=True, slots=True)
class EventLog:
    """The events of a run. stages: first time of each. left_out: events beyond the limits.

    images_end_s: when drawn images and mixtures ended; None where they did not.
    """

    events: tuple[LogEvent, ...] = ()
    preflight: tuple[LogEvent, ...] = ()
    before_arming: tuple[LogEvent, ...] = ()
    stages: tuple[tuple[str, float], ...] = ()
    images_end_s: float | None = None
    left_out: int = 0
    problems: tuple[str, ...] = ()


def read_event_log(path: Path) -> EventLog:
    """Return the events of a log, as far as the file is readable."""
    try:
        data = read_limited_data(path)
    except UnreadableError as error:
        return EventLog(problems=(str(error),))
    kept: dict[str, list[LogEvent]] = {"preflight": [], "before_arming": [], "": []}
    stages: dict[str, float] = {}
    images_end_s: float | None = None
    counts: Counter[str] = Counter()
    found = damaged = left_out = 0
    for line in BytesIO(data):  # not split(): a long file would be in memory three times
        if not line.strip():
            continue
        found += 1
        parsed = _parse(line)
        if parsed is None:
            damaged += 1
            continue
        t_s, kind, fields = parsed
        group = kept[kind if kind in kept else ""]
        counts[kind] += 1
        images_end_s = t_s if kind == "images_ended" else images_end_s
        has_room = kind in _OWN_LIMIT and counts[kind] <= MOST_EVENTS
        is_kept = has_room or len(group) < MOST_EVENTS
        if is_kept or kind == "stage":
            event = _event(t_s, kind, fields)
            if is_kept:
                group.append(event)
            if kind == "stage":
                stages.setdefault(event.text, t_s)
        left_out += group is kept[""] and not is_kept
    problems = (f"{path.name}: {damaged} lines are not events",) if damaged else ()
    return EventLog(
        events=tuple(kept[""]),
        preflight=tuple(kept["preflight"]),
        before_arming=tuple(kept["before_arming"]),
        stages=tuple(stages.items()),
        images_end_s=images_end_s,
        left_out=left_out,
        problems=problems if found else (f"{path.name} is empty",),
    )


def _parse(line: bytes) -> tuple[float, str, dict[str, Any]] | None:
    """Return time, kind and fields of a line; None for a damaged one."""
    try:
        fields = loads_limited_json(line.decode("utf-8", "replace").encode())
        t_s, kind = float(fields["t_s"]), fields["event"]
    except (ValueError, KeyError, TypeError, OverflowError):
        return None
    if not isinstance(kind, str) or not math.isfinite(t_s):
        return None
    return t_s, kind, fields


def _event(t_s: float, kind: str, fields: dict[str, Any]) -> LogEvent:
    rest = {name: value for name, value in fields.items() if name not in {"t_s", "event"}}
    subject = _first_text(rest, "vehicle", "who")
    oracle = _first_text(rest, "oracle") if kind == "flag" else ""
    return LogEvent(t_s, kind, subject, " · ".join(_words(kind, rest)), oracle)


def _first_text(fields: dict[str, Any], *names: str) -> str:
    return next((str(fields[name]) for name in names if fields.get(name)), "")


def _words(kind: str, fields: dict[str, Any]) -> Iterator[str]:
    """Yield the values of an event: the main ones alone, others with their names."""
    bare = {"stage", "text", "reason", "message"} | ({"kind"} if kind != "decisive" else set())
    if kind == "preflight":
        bare |= {"check", "outcome"}
    if kind == "fence" or fields.get("step") == "fence":
        yield "the autopilot's own fence, larger than the campaign's by its margin"
        fields = {name: value for name, value in fields.items() if name != "step"}
    if kind == "before_arming":
        bare |= {"step"}
        fields = {name: value for name, value in fields.items() if name != "ok" or value is False}
    for name, value in fields.items():
        if name in {"vehicle", "who"} or value in (None, ""):
            continue
        shown = f"{value:g}" if isinstance(value, float) else str(value)
        yield shown if name in bare else f"{name} {shown}"
