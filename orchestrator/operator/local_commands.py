"""Sends operator commands from the CLI and the console to the flights of this machine."""

import os
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from orchestrator.operator.campaign_records import Place, Places, places
from orchestrator.operator.socket_client import NoAnswerError, ask, tell
from safety.guard.core.operator_command import OperatorKind


@dataclass(frozen=True, slots=True)
class CommandReply:
    """The reply of one campaign or guard to a command, in words."""

    ok: bool
    text: str


def tell_guards(folder: Path, who: str) -> None:
    """Make the guards of one results folder land their vehicles; does not wait for replies."""
    try:
        guards = places().beneath(folder).guards
    except OSError:
        return  # the run gets the abort by its pipe as well
    for guard in guards:
        tell(guard.socket, "abort", who=who)


def send_command(flying: Places, kind: OperatorKind, who: str) -> Iterator[CommandReply]:
    """Send abort, hold or resume to campaigns and guards; yield the replies as they come.

    An abort goes to all guards and campaigns at the same time; a process whose socket does not
    answer gets SIGTERM, on which it lands as well. Hold and resume go to campaigns, and to guards
    only where no campaign is left.
    """
    return _abort(flying, who) if kind == "abort" else _to_campaigns(flying, kind, who)


def abort_place(flying: Places, who: str, *, node: str, bench: str) -> Iterator[CommandReply]:
    """Make campaigns land their runs on one node or bench of a cluster; yield the replies."""
    names = {name: text for name, text in (("node", node), ("bench", bench)) if text}
    for campaign in flying.campaigns:
        yield _send_to_socket(campaign, "abort", who, **names)


def _abort(flying: Places, who: str) -> Iterator[CommandReply]:
    """Send abort to all sockets at once, so that none delays another; signal those that fail."""
    everyone = (*flying.guards, *flying.campaigns)
    with ThreadPoolExecutor(max(1, len(everyone))) as threads:
        replies = list(threads.map(lambda one: _send_to_socket(one, "abort", who), everyone))
    yield from replies
    for place, reply in zip(everyone, replies, strict=True):
        if not reply.ok:
            yield from _signal(place)


def _signal(place: Place) -> Iterator[CommandReply]:
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
        )
        return
    yield CommandReply(
        ok=False,
        text=f"{place.name}: SIGTERM was sent to process {process.pid}; `wil-campaign watch` shows "
        "whether it lands",
    )


def _to_campaigns(flying: Places, kind: OperatorKind, who: str) -> Iterator[CommandReply]:
    """Send an operator's command to campaigns; to guards only where no campaign is left."""
    orphans = list(flying.guards)
    for campaign in flying.campaigns:
        own = flying.guards_of(campaign)
        try:
            answer = ask(campaign.socket, kind, who=who)
        except NoAnswerError as error:
            yield CommandReply(ok=False, text=str(error))
            continue
        yield _reply(campaign, answer)
        orphans = [one for one in orphans if one not in own]
    for guard in orphans:
        yield _send_to_socket(guard, kind, who)


def _send_to_socket(place: Place, kind: OperatorKind, who: str, **more: str) -> CommandReply:
    """Send an operator's command to a socket; return its reply."""
    try:
        return _reply(place, ask(place.socket, kind, who=who, **more))
    except NoAnswerError as error:
        return CommandReply(ok=False, text=str(error))


def _reply(place: Place, answer: dict[str, object]) -> CommandReply:
    """Return a socket's answer to an operator's command as a reply."""
    return CommandReply(ok=answer.get("ok") is True, text=f"{place.name}: {answer.get('text', '')}")
