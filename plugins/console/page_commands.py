"""Sends an operator's commands from the page to the operator sockets of runs and guards."""

import asyncio
import json
import secrets
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast, get_args

from wil_campaign.orchestrator.operator.campaign_records import OperatorPlace, OperatorPlaces
from wil_campaign.orchestrator.operator.local_commands import (
    CommandReply,
    send_command,
    unconfirmed_places,
    unconfirmed_texts,
)
from wil_campaign.orchestrator.operator.operator_log import OperatorLog
from wil_campaign.orchestrator.operator.socket_client import NoAnswerError, ask_operator_socket
from wil_campaign.plugins.console.console_access import AccessError
from wil_campaign.plugins.console.flight_scope import FlightScope
from wil_campaign.safety.guard.core.operator_command import OperatorKind
from wil_campaign.safety.guard.operator.operator_lines import LONGEST_LINE_BYTES, require_fresh

MAX_BODY_BYTES = LONGEST_LINE_BYTES // 2
"""Limit on a request: encoded as JSON again, it must fit into a line of the socket."""
_THREADS = 16
_OLDEST_S = 10.0
"""A page waits 5 s for its reply, and has a status every half second, or every four where a flight
does not answer."""
_KEYS = frozenset({"command", "geofence", "seen_s"})


@dataclass(frozen=True, slots=True)
class PageCommand:
    """A command from a page. document: the text of new fences."""

    kind: OperatorKind
    document: str = ""

    @classmethod
    def parse(cls, document: Any, now_s: float) -> "PageCommand":
        """Return the command in a request's JSON. Raises AccessError, and RefusedLineError.

        now_s: by the clock of `seen_s`, which is when the status was sent that the page had last.
        """
        if not isinstance(document, dict) or set(document) - _KEYS:
            raise AccessError("a command has the keys command and, for a fence, geofence")
        kind, fences = document.get("command"), document.get("geofence", "")
        if kind not in get_args(OperatorKind):
            raise AccessError(f"command must be one of {', '.join(get_args(OperatorKind))}")
        if not isinstance(fences, str) or (kind == "geofence") != bool(fences):
            raise AccessError("geofence must be the text of a file, for command geofence only")
        require_fresh(cast("OperatorKind", kind), document.get("seen_s"), now_s, oldest_s=_OLDEST_S)
        return cls(cast("OperatorKind", kind), fences)


@dataclass(frozen=True, slots=True)
class CommandOutcome:
    """What became of a command from a page. texts: the replies.

    is_obeyed: by one flight at least. unconfirmed: the flights that did not confirm it.
    """

    is_obeyed: bool
    texts: tuple[str, ...]
    unconfirmed: tuple[OperatorPlace, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether each flight has confirmed the command."""
        return self.is_obeyed and not self.unconfirmed

    @classmethod
    def of(cls, replies: Sequence[CommandReply], flying: OperatorPlaces) -> "CommandOutcome":
        """Return the outcome of a command by its replies. flying: the flights it was sent to."""
        missing = unconfirmed_places(flying, replies)
        notes = unconfirmed_texts(missing, flying, replies)
        texts = (*(reply.text for reply in replies), *notes)
        return cls(any(reply.ok for reply in replies), texts, missing)


class CommandSender:
    """Sends commands to a scope's flights in threads, so that an abort never waits."""

    def __init__(self, scope: FlightScope) -> None:
        self._scope = scope
        self._logs: dict[Path, OperatorLog] = {}
        self._threads = ThreadPoolExecutor(_THREADS, thread_name_prefix="command")

    async def send(self, command: PageCommand, who: str) -> CommandOutcome:
        """Send a command; return what became of it."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._threads, self._send, command, who)

    def refuse(self, text: str) -> None:
        """Record a refused request in operator.jsonl of the campaigns in flight."""
        self._threads.submit(self._record, text)

    def close(self) -> None:
        """End the threads, after the commands in progress."""
        self._threads.shutdown(wait=True)

    def _send(self, command: PageCommand, who: str) -> CommandOutcome:
        try:
            flying = self._scope.places()
        except OSError as error:
            return CommandOutcome(is_obeyed=False, texts=(str(error),))
        if not flying.campaigns and not flying.guards:
            where = "on this machine" if self._scope.is_whole_machine else "for this console"
            return CommandOutcome(is_obeyed=False, texts=(f"no campaign is in flight {where}",))
        if command.kind == "geofence":
            reply = _change_fences(flying, command.document, who)
            return CommandOutcome(is_obeyed=reply.ok, texts=(reply.text,))
        return CommandOutcome.of(list(send_command(flying, command.kind, who)), flying)

    def _record(self, text: str) -> None:
        try:
            flying = self._scope.places().campaigns
        except OSError:
            return
        for campaign in flying:
            path = campaign.folder / "operator.jsonl"
            self._logs.setdefault(path, OperatorLog(path=path)).refused(text, who="console")


def _change_fences(flying: OperatorPlaces, document: str, who: str) -> CommandReply:
    """Send new fences to the one campaign in flight; its runs answer later, in its status."""
    if len(flying.campaigns) != 1:
        return CommandReply(
            ok=False,
            text=f"geofence: {len(flying.campaigns)} campaigns are in flight; it needs exactly one",
        )
    (campaign,) = flying.campaigns
    try:
        answer = ask_operator_socket(
            campaign.socket, "geofence", who=who, geofence=document, id=secrets.token_hex(8)
        )
    except NoAnswerError as error:
        return CommandReply(ok=False, text=str(error))
    return CommandReply(
        ok=answer.get("ok") is True, text=f"{campaign.name}: {answer.get('text', '')}"
    )


def parse_request_body(body: bytes) -> Any:
    """Return the JSON of a request. Raises AccessError."""
    try:
        return json.loads(body.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise AccessError("the request is not JSON") from error
