"""log.jsonl as lines for people; a line that is none is counted, not believed."""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orchestrator.analysis.reading.results_folder import UnreadableError, read_text
from orchestrator.report.model import LogEvent

MOST_EVENTS = 400
"""What a page shows of a run; a vehicle that repeats itself would drown the rest."""


@dataclass(frozen=True, slots=True)
class EventLog:
    """What happened in a run. stages: when each was reached first. left_out: lines not kept."""

    events: tuple[LogEvent, ...] = ()
    preflight: tuple[LogEvent, ...] = ()
    before_arming: tuple[LogEvent, ...] = ()
    stages: tuple[tuple[str, float], ...] = ()
    left_out: int = 0
    problems: tuple[str, ...] = ()


def read_event_log(path: Path) -> EventLog:
    """Return what a log tells, as far as it can be read."""
    try:
        lines = read_text(path).splitlines()
    except UnreadableError as error:
        return EventLog(problems=(str(error),))
    found = [_event(line) for line in lines if line.strip()]
    told = [event for event in found if event is not None]
    damaged = len(found) - len(told)
    problems = (f"{path.name}: {damaged} lines are no events",) if damaged else ()
    if not found:
        problems = (f"{path.name} is empty",)
    events = [event for event in told if event.kind not in {"preflight", "before_arming"}]
    stages: dict[str, float] = {}
    for event in events:
        if event.kind == "stage":
            stages.setdefault(event.text, event.t_s)
    return EventLog(
        events=tuple(events[:MOST_EVENTS]),
        preflight=tuple(event for event in told if event.kind == "preflight")[:MOST_EVENTS],
        before_arming=tuple(one for one in told if one.kind == "before_arming")[:MOST_EVENTS],
        stages=tuple(stages.items()),
        left_out=max(0, len(events) - MOST_EVENTS),
        problems=problems,
    )


def _event(line: str) -> LogEvent | None:
    try:
        fields = json.loads(line)
        t_s, kind = float(fields["t_s"]), fields["event"]
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
    if not isinstance(kind, str) or not math.isfinite(t_s):
        return None
    rest = {name: value for name, value in fields.items() if name not in {"t_s", "event"}}
    subject = _first_text(rest, "vehicle", "who")
    return LogEvent(t_s, kind, subject, " · ".join(_words(kind, rest)))


def _first_text(fields: dict[str, Any], *names: str) -> str:
    return next((str(fields[name]) for name in names if fields.get(name)), "")


def _words(kind: str, fields: dict[str, Any]) -> Iterator[str]:
    """Yield what an event tells: its main words bare, anything else with its name."""
    bare = {"stage", "text", "reason", "message"} | ({"kind"} if kind != "decisive" else set())
    if kind == "preflight":
        bare |= {"check", "outcome"}
    if kind == "before_arming":
        bare |= {"step"}
        fields = {name: value for name, value in fields.items() if name != "ok" or value is False}
    for name, value in fields.items():
        if name in {"vehicle", "who"} or value in (None, ""):
            continue
        shown = f"{value:g}" if isinstance(value, float) else str(value)
        yield shown if name in bare else f"{name} {shown}"
