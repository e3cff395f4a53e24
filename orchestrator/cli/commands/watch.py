"""`wil-campaign watch`: shows the runs in flight on this machine, on any terminal."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from orchestrator.cli.commands.operate import NONE_OBEYED, find_campaigns, list_flights
from orchestrator.cli.standard_streams import out
from orchestrator.operator.campaign_records import Place, Places
from orchestrator.operator.socket_client import NoAnswerError, ask

_EVERY_S = 0.5


def watch(
    folder: Path | None = None,
    *,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Show the runs in flight on this machine until they end; Ctrl-C ends only the display.

    Parameters
    ----------
    folder
        Only the campaign or run with this results folder.
    json_
        Print every status as one JSON object a line, twice a second.
    """
    flying = find_campaigns(folder)
    if flying is None:
        return NONE_OBEYED
    last: dict[Path, str] = {}
    while flying.campaigns or flying.guards:
        for place, status in _statuses(flying):
            line = json.dumps(status) if json_ else _line(place, status)
            if json_ or last.get(place.socket) != line:
                out(line)
            last[place.socket] = line
        time.sleep(_EVERY_S)
        flying = list_flights(folder)
        if flying is None:
            return NONE_OBEYED
    return 0


def _statuses(flying: Places) -> Iterator[tuple[Place, dict[str, Any]]]:
    """Return the status of everything in flight, for `watch`."""
    for place in (*flying.campaigns, *flying.guards):
        try:
            status = ask(place.socket, "status", who="watch")
        except NoAnswerError:
            continue  # It may just have ended.
        yield place, {key: value for key, value in status.items() if key not in {"ok", "text"}}


def _line(place: Place, status: dict[str, Any]) -> str:
    """Return the line that `watch` prints about a campaign or guard."""
    if "vehicles" in status:
        phases = ", ".join(f"{name} {phase}" for name, phase in status["vehicles"].items())
        held = " held" if status["held"] else ""
        latched = f" [{status['latched']}]" if status["latched"] else ""
        lost = " (its orchestrator is lost)" if status["orchestrator"] == "lost" else ""
        return f"guard of {place.name}:{held}{latched}{lost} {phases}"
    verdicts = list(status["finished"].values())
    counts = ", ".join(f"{verdicts.count(one)} {one}" for one in sorted(set(verdicts)))
    flying = "; ".join(
        f"{name}{_where(run)}: {run['stage']}, {run['verdict_so_far']} so far"
        for name, run in status["flying"].items()
    )
    held = " (held)" if status["held"] else " (landing)" if status["stopped"] else ""
    done = f"{len(verdicts)} of {status['total']} runs"
    return f"{place.name}{held}: {done}{f' ({counts})' if counts else ''}; {flying or 'none flies'}"


def _where(run: dict[str, Any]) -> str:
    """Return where a run flies, for a message; "" for this machine."""
    place = run.get("place")
    return f" on {place}" if place else ""
