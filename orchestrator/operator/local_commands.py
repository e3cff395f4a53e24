"""Sends operator commands from the CLI and the console to the flights of this machine."""

import os
import signal
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.orchestrator.operator.campaign_records import (
    OperatorPlace,
    OperatorPlaces,
    operator_places,
)
from wil_campaign.orchestrator.operator.socket_client import (
    NoAnswerError,
    ask_operator_socket,
    tell_operator_socket,
)
from wil_campaign.safety.guard.core.operator_command import OperatorKind

_RECORD_GOES_S = 0.2
"""How long after its socket a campaign's record goes."""


@dataclass(frozen=True, slots=True)
class CommandReply:
    """The reply of one campaign or guard to a command, in words.

    place: the campaign or guard; None for a command that was not sent. answered: by its socket.
    """

    ok: bool
    text: str
    place: OperatorPlace | None = None
    answered: bool = False


def tell_guards(folder: Path, who: str) -> None:
    """Make the guards of one results folder land their vehicles; does not wait for replies."""
    try:
        guards = operator_places().beneath(folder).guards
    except OSError:
        return  # the run gets the abort by its pipe as well
    for guard in guards:
        tell_operator_socket(guard.socket, "abort", who=who)


def send_command(flying: OperatorPlaces, kind: OperatorKind, who: str) -> Iterator[CommandReply]:
    """Send abort, hold or resume to campaigns and guards; yield the replies as they come.

    An abort goes to all guards and campaigns at the same time; a process whose socket does not
    answer gets SIGTERM, on which it lands as well. Hold and resume go to campaigns, and to guards
    only where no campaign is left.
    """
    return _abort(flying, who) if kind == "abort" else _to_campaigns(flying, kind, who)


def abort_place(
    flying: OperatorPlaces, who: str, *, node: str, bench: str
) -> Iterator[CommandReply]:
    """Make campaigns land their runs on one node or bench of a cluster; yield the replies."""
    names = {name: text for name, text in (("node", node), ("bench", bench)) if text}
    for campaign in flying.campaigns:
        yield _send_to_socket(campaign, "abort", who, **names)


def unconfirmed_places(
    flying: OperatorPlaces, replies: Iterable[CommandReply]
) -> tuple[OperatorPlace, ...]:
    """Return the campaigns and guards among flights that have not confirmed a command.

    A campaign's program confirms it, or the guard of each of its runs; a program that has ended
    has only its guards. The guard of a run without a campaign confirms it by itself.
    """
    confirmed = {reply.place for reply in replies if reply.ok}
    missing = []
    orphans = list(flying.guards)
    for campaign in flying.campaigns:
        own = flying.guards_of(campaign)
        orphans = [guard for guard in orphans if guard not in own]
        has_ended = campaign.process is not None and not campaign.process.lives
        by_guards = bool(own or has_ended) and confirmed.issuperset(own)
        if campaign not in confirmed and not by_guards:
            missing.append(campaign)
    return (*missing, *(guard for guard in orphans if guard not in confirmed))


def unconfirmed_texts(
    missing: Iterable[OperatorPlace], flying: OperatorPlaces, replies: Iterable[CommandReply]
) -> Iterator[str]:
    """Yield in words what has not confirmed a command; a refusal, with its reason, is a reply."""
    refusing = {reply.place for reply in replies if reply.answered}
    for place in missing:
        if place in refusing:
            continue
        who = (
            "neither its program nor the guard of each of its runs has confirmed the command"
            if place in flying.campaigns
            else "the guard has not confirmed the command"
        )
        yield (
            f"{place.name}: {who}; `wil-campaign watch` shows its vehicles: send the command "
            "again, or land them by the transmitter"
        )


def commanded_campaigns(flying: OperatorPlaces, replies: Iterable[CommandReply]) -> OperatorPlaces:
    """Return the campaigns that a command for one node or bench concerns, by their replies.

    A campaign that refuses it has no run there; one that does not answer may have one.
    """
    refusing = {reply.place for reply in replies if reply.answered and not reply.ok}
    return OperatorPlaces(
        tuple(campaign for campaign in flying.campaigns if campaign not in refusing), ()
    )


def _abort(flying: OperatorPlaces, who: str) -> Iterator[CommandReply]:
    """Send abort to all sockets at once, so that none delays another; signal those that fail."""
    everyone = (*flying.guards, *flying.campaigns)
    with ThreadPoolExecutor(max(1, len(everyone))) as threads:
        replies = list(threads.map(lambda one: _send_abort(one, who), everyone))
    yield from replies
    for place, reply in zip(everyone, replies, strict=True):
        if not reply.ok:
            yield from _signal(place)


def _send_abort(place: OperatorPlace, who: str) -> CommandReply:
    """Send an abort to a socket; return its reply, or that the campaign flies nothing any more.

    A campaign closes its socket after its last flight, then removes its record, and goes on to
    write its report.
    """
    reply = _send_to_socket(place, "abort", who)
    if reply.ok or reply.answered:
        return reply
    if place.has_ended(within_s=_RECORD_GOES_S):
        return CommandReply(ok=True, text=f"{place.name}: its flights are over", place=place)
    return reply


def _signal(place: OperatorPlace) -> Iterator[CommandReply]:
    """Send SIGTERM to a campaign or a guard; both land on it."""
    process = place.process
    if process is None or not process.lives:
        return
    try:
        os.kill(process.pid, signal.SIGTERM)
    except OSError as error:
        yield CommandReply(
            ok=False,
            text=f"{place.name}: SIGTERM cannot be sent to process {process.pid}: {error.strerror}",
            place=place,
        )
        return
    yield CommandReply(
        ok=False,
        text=f"{place.name}: SIGTERM was sent to process {process.pid}; `wil-campaign watch` shows "
        "whether it lands",
        place=place,
    )


def _to_campaigns(flying: OperatorPlaces, kind: OperatorKind, who: str) -> Iterator[CommandReply]:
    """Send an operator's command to campaigns; to guards only where no campaign is left."""
    orphans = list(flying.guards)
    for campaign in flying.campaigns:
        own = flying.guards_of(campaign)
        try:
            answer = ask_operator_socket(campaign.socket, kind, who=who)
        except NoAnswerError as error:
            yield _no_answer(campaign, error)
            continue
        yield _reply(campaign, answer)
        orphans = [orphan for orphan in orphans if orphan not in own]
    for guard in orphans:
        yield _send_to_socket(guard, kind, who)


def _send_to_socket(
    place: OperatorPlace, kind: OperatorKind, who: str, **more: str
) -> CommandReply:
    """Send an operator's command to a socket; return its reply."""
    try:
        return _reply(place, ask_operator_socket(place.socket, kind, who=who, **more))
    except NoAnswerError as error:
        return _no_answer(place, error)


def _no_answer(place: OperatorPlace, error: NoAnswerError) -> CommandReply:
    return CommandReply(ok=False, text=f"{place.name}: {error}", place=place)


def _reply(place: OperatorPlace, answer: dict[str, object]) -> CommandReply:
    text = f"{place.name}: {answer.get('text', '')}"
    return CommandReply(ok=answer.get("ok") is True, text=text, place=place, answered=True)
