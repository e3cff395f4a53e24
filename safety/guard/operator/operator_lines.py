"""The lines of the operator's socket: requests parsed, answers written; pure.

Each line is one JSON object. Requests:
{"command": "abort" | "hold" | "resume" | "status" | "watch", "who": "anna", "token": "..."}
{"command": "abort", "node": "desk", "who": "anna"}, or "bench": for campaigns only
{"command": "geofence", "geofence": "the text of a file", "id": "a1", "who": "anna"}
Any but an abort may have "at_s", when it was sent, by CLOCK_MONOTONIC: it is refused 5 s later.
Answer: {"ok": true, "command": "abort", "text": "...", ...}
"""

import hmac
import json
from collections.abc import Mapping
from typing import Any, Literal, cast, get_args

from wil_campaign.foundation.files.problems import is_encodable
from wil_campaign.safety.guard.core.operator_command import OperatorCommand, OperatorKind

LONGEST_LINE_BYTES = 1 << 16
OLDEST_S = 5.0
"""What waited longer for a process that stood still is no operator's present wish, but an abort."""
_LONGEST_WHO = 64
Query = Literal["status", "watch"]
_QUERIES: frozenset[str] = frozenset(get_args(Query))
_WORDS = (*get_args(OperatorKind), *get_args(Query))
_KEYS = frozenset({"command", "who", "token", "geofence", "id", "node", "bench", "at_s"})


class RefusedLineError(ValueError):
    """A line of the operator's socket is refused; the message is the reason."""


def parse_line(line: bytes, *, token: str = "", now_s: float = 0.0) -> OperatorCommand | Query:
    """Return the command or query in an operator's line. Raises RefusedLineError.

    token: the token that the line must hold; empty if none is required. now_s: CLOCK_MONOTONIC.
    """
    if len(line) > LONGEST_LINE_BYTES:
        raise RefusedLineError(f"the line is longer than {LONGEST_LINE_BYTES} bytes")
    try:
        request: Any = json.loads(line.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise RefusedLineError("the line is not UTF-8") from error
    except (ValueError, RecursionError) as error:
        raise RefusedLineError("the line is not JSON") from error
    if not isinstance(request, dict):
        raise RefusedLineError("the line is not a JSON object")
    # ascii(): JSON allows half of a surrogate pair, which no log can hold.
    if extra := sorted(ascii(key)[1:-1] for key in set(request) - _KEYS):
        raise RefusedLineError(f"unknown keys: {', '.join(extra)[:_LONGEST_WHO]}")
    if token and not is_operator_token(request.get("token"), token):
        raise RefusedLineError(
            "the token is wrong" if "token" in request else "a token is required"
        )
    command = request.get("command")
    if not isinstance(command, str) or command not in _WORDS:
        raise RefusedLineError(f"command must be one of {', '.join(_WORDS)}")
    who = checked_operator_name(request.get("who", "operator"))
    if command in _QUERIES:
        return cast("Query", command)
    require_fresh(cast("OperatorKind", command), request.get("at_s", now_s), now_s)
    return _command(cast("OperatorKind", command), who, request)


def _command(kind: OperatorKind, who: str, request: Mapping[str, Any]) -> OperatorCommand:
    if kind != "geofence":
        node, bench = request.get("node", ""), request.get("bench", "")
        if not isinstance(node, str) or not isinstance(bench, str):
            raise RefusedLineError("node and bench must be texts")
        _require_whole("node and bench", node + bench)
        if kind != "abort" and (node or bench):
            raise RefusedLineError(f"{kind}: node and bench are allowed with abort only")
        return OperatorCommand(kind, who, node=node, bench=bench)
    document, command_id = request.get("geofence"), request.get("id")
    if not isinstance(document, str) or not isinstance(command_id, str):
        raise RefusedLineError("geofence must be the text of a file, and id a text not used before")
    _require_whole("geofence and id", document + command_id)
    return OperatorCommand("geofence", who, document=document, command_id=command_id)


def require_fresh(
    kind: OperatorKind, at_s: Any, now_s: float, *, oldest_s: float = OLDEST_S
) -> None:
    """Raise RefusedLineError for a command, but an abort, that was sent too long ago.

    at_s, now_s: of one monotonic clock.
    """
    if kind == "abort":
        return
    if isinstance(at_s, bool) or not isinstance(at_s, int | float):
        raise RefusedLineError(f"{kind}: when it was sent is not known")
    if not at_s >= now_s - oldest_s:  # also for NaN
        raise RefusedLineError(
            f"{kind}: it was sent more than {oldest_s:g} s ago, and is not executed; give it again"
        )


def _require_whole(what: str, text: str) -> None:
    """Raise RefusedLineError for a text that cannot be encoded."""
    if not is_encodable(text):
        raise RefusedLineError(f"{what} must be texts of whole characters")


def checked_operator_name(who: Any) -> str:
    """Return an operator's name if the log can hold it. Raises RefusedLineError."""
    if not isinstance(who, str) or not 1 <= len(who) <= _LONGEST_WHO or not who.isprintable():
        raise RefusedLineError(f"who must be a name of 1 to {_LONGEST_WHO} printable characters")
    return who


def is_operator_token(given: Any, token: str) -> bool:
    """Return whether an operator's token is right, in constant time."""
    return isinstance(given, str) and hmac.compare_digest(
        given.encode("utf-8", "replace"), token.encode()
    )


def answer_line(*, ok: bool, text: str, command: str = "", **details: Any) -> bytes:
    """Return the reply line to an operator."""
    document = {"ok": ok, "command": command, "text": text, **details}
    return json.dumps(document, ensure_ascii=False).encode() + b"\n"
