"""`wil-campaign watch`: shows the runs in flight on this machine, on any terminal."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from wil_campaign.orchestrator.cli.flight_choice import (
    NONE_OBEYED,
    find_campaigns,
    list_flights,
    status_line,
)
from wil_campaign.orchestrator.cli.standard_streams import write_stdout
from wil_campaign.orchestrator.operator.campaign_records import OperatorPlace, OperatorPlaces
from wil_campaign.orchestrator.operator.socket_client import NoAnswerError, ask_operator_socket
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.run_results.acceptance_texts import required_text

_EVERY_S = 0.5
_WORDS = {True: "accepted", False: "not accepted", None: "nothing required was flown"}


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
    seen: dict[Path, str] = {}
    while flying.campaigns or flying.guards:
        seen |= {place.folder: place.name for place in flying.campaigns}
        for place, status in _statuses(flying):
            if status is None:
                line = "" if json_ else f"{place.name}: it does not answer; its state is not known"
            else:
                line = json.dumps(status) if json_ else status_line(place, status)
            if line and (json_ or last.get(place.socket) != line):
                write_stdout(line)
            last[place.socket] = line
        time.sleep(_EVERY_S)
        flying = list_flights(folder)
        if flying is None:
            return NONE_OBEYED
    for flown, name in () if json_ else seen.items():
        write_stdout(_verdict_line(flown, name))
    return 0


def _verdict_line(folder: Path, name: str) -> str:
    """Return how a campaign that is over ended, by its summary."""
    try:
        documents = read_campaign_documents(folder)
    except ResultsFolderError:
        documents = None
    if documents is None or documents.summary is None:
        return f"{name}: over, and {folder} has no readable summary"
    summary = documents.summary
    required = required_text(summary, documents.requirements)
    return f"{name}: {_WORDS[summary.accepted]}; {required}; results: {folder}"


def _statuses(flying: OperatorPlaces) -> Iterator[tuple[OperatorPlace, dict[str, Any] | None]]:
    """Return the status of everything in flight, for `watch`; None of what does not answer."""
    for place in (*flying.campaigns, *flying.guards):
        try:
            status = ask_operator_socket(place.socket, "status", who="watch")
        except NoAnswerError:
            has_ended = place.process is not None and not place.process.lives
            if place.socket.exists() and not has_ended:
                yield place, None
            continue
        yield place, {key: value for key, value in status.items() if key not in {"ok", "text"}}
