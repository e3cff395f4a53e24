"""Which of the flights on this machine a command is for: one campaign's, or all with --all."""

import shlex
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wil_campaign.orchestrator.cli.standard_streams import write_stderr
from wil_campaign.orchestrator.operator.campaign_records import (
    OperatorPlace,
    OperatorPlaces,
    operator_places,
)
from wil_campaign.orchestrator.operator.socket_client import NoAnswerError, ask_operator_socket
from wil_campaign.safety.guard.process.runtime_folder import unsafe_folders

NONE_OBEYED = 3
"""The exit code when no run is in flight, or a flight does not confirm a command."""
AMBIGUOUS = 2
"""The exit code when a command does not say for which of several campaigns it is."""


@dataclass(frozen=True, slots=True)
class TypedCommand:
    """A command as it was typed, so that it can be shown completed.

    verb: what it does with campaigns, in words. words: before the folder, options: after it.
    """

    verb: str
    words: tuple[str, ...]
    options: tuple[str, ...] = ()

    def line(self, folder: Path | None, *, is_all: bool = False) -> str:
        """Return the line to type for a folder, or for all."""
        where = () if folder is None else (str(folder),)
        every = ("--all",) if is_all else ()
        return shlex.join(("wil-campaign", *self.words, *where, *every, *self.options))


def choose_flights(
    folder: Path | None, typed: TypedCommand, *, is_all: bool
) -> OperatorPlaces | int:
    """Return the flights that a command is for; the exit code, after a message, without any.

    Several campaigns need a folder of one, or `is_all`: they are listed, each with its line.
    """
    flying = find_campaigns(folder)
    if flying is None:
        return NONE_OBEYED
    campaigns = flying.by_campaign()
    if is_all or len(campaigns) == 1:
        return flying
    where = "on this machine" if folder is None else f"in {folder}"
    write_stderr(
        f"{len(campaigns)} campaigns are in the air {where}; nothing was sent. "
        f"To {typed.verb} all of them:\n  {typed.line(folder, is_all=True)}\nor one of them:"
    )
    with ThreadPoolExecutor(len(campaigns)) as threads:
        for found, text in zip(campaigns, threads.map(_summary, campaigns.values()), strict=True):
            write_stderr(f"  {typed.line(found)}  # {text}")
    return AMBIGUOUS


def new_flights(folder: Path | None, known: OperatorPlaces) -> OperatorPlaces | None:
    """Return the flights of campaigns begun meanwhile; None, after a message, on an OSError."""
    flying = list_flights(folder)
    if flying is None:
        return None
    before = known.by_campaign()
    found = OperatorPlaces((), ())
    for campaign, more in flying.by_campaign().items():
        if campaign not in before:
            found |= more
    return found


def find_campaigns(folder: Path | None) -> OperatorPlaces | None:
    """Return the flights beneath a folder; None, after a message, when there are none."""
    flying = list_flights(folder)
    if flying is None:
        return None
    if not flying.campaigns and not flying.guards:
        write_stderr(
            "no campaign is in flight on this machine"
            if folder is None
            else f"no run is in flight in {folder}"
        )
        for text in unsafe_folders():
            write_stderr(f"{text}: this folder was not searched")
        return None
    return flying


def list_flights(folder: Path | None) -> OperatorPlaces | None:
    """Return the flights beneath a folder, possibly none; None, after a message, on an OSError."""
    try:
        return operator_places().beneath(folder)
    except OSError as error:
        where = "" if error.filename is None else f"{error.filename}: "
        write_stderr(
            "the records of this machine's flights cannot be read: "
            f"{where}{error.strerror or error}; check who may read this folder"
        )
        return None


def status_line(place: OperatorPlace, status: dict[str, Any]) -> str:
    """Return a campaign's or guard's status in a line."""
    if "vehicles" in status:
        phases = ", ".join(f"{name} {phase}" for name, phase in status["vehicles"].items())
        held = " held" if status["held"] else ""
        latched = f" [{status['latched']}]" if status["latched"] else ""
        lost = " (its orchestrator is lost)" if status["orchestrator"] == "lost" else ""
        return f"guard of {place.name}:{held}{latched}{lost} {phases}"
    verdicts = list(status["finished"].values())
    counts = ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in sorted(set(verdicts)))
    flying = "; ".join(
        f"{name}{_where(run)}: {run['stage']}, {run['verdict_so_far'] or 'nothing decided'} so far"
        for name, run in status["flying"].items()
    )
    held = " (held)" if status["held"] else " (landing)" if status["stopped"] else ""
    done = f"{len(verdicts)} of {status['total']} runs"
    return f"{place.name}{held}: {done}{f' ({counts})' if counts else ''}; {flying or 'none flies'}"


def _where(run: dict[str, Any]) -> str:
    """Return where a run flies, for a message; "" for this machine."""
    place = run.get("place")
    return f" on {place}" if place else ""


def _summary(flying: OperatorPlaces) -> str:
    """Return in words what flies of one campaign: by its programs, or by the guards left over."""
    return "; ".join(map(_place_summary, flying.campaigns or flying.guards))


def _place_summary(place: OperatorPlace) -> str:
    try:
        return status_line(place, ask_operator_socket(place.socket, "status", who="operator"))
    except NoAnswerError:
        return f"{place.name}: it does not answer"
