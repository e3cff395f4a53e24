"""What an operator's socket hears and answers: one JSON object a line; pure.

Asked: {"command": "abort" | "hold" | "resume" | "status" | "watch", "who": "anna", "token": "..."}
or {"command": "abort", "node": "desk", "who": "anna"}, which a campaign takes, or with "bench"
or {"command": "geofence", "geofence": "the text of a file", "id": "a1", "who": "anna"}
Answered: {"ok": true, "command": "abort", "text": "...", ...}
"""

import hmac
import json
from collections.abc import Mapping
from typing import Any, Literal, cast, get_args

from safety.guard.core.operator_command import OperatorCommand, OperatorKind

LONGEST_LINE_BYTES = 1 << 16
_LONGEST_WHO = 64
Query = Literal["status", "watch"]
_QUERIES: frozenset[str] = frozenset(get_args(Query))
_WORDS = (*get_args(OperatorKind), *get_args(Query))
_KEYS = frozenset({"command", "who", "token", "geofence", "id", "node", "bench"})


class RefusedLineError(ValueError):
    """A refused line of the operator's socket; says why."""


def parse_line(line: bytes, *, token: str = "") -> OperatorCommand | Query:
    """Return the command or query in an operator's line. Raises RefusedLineError.

    token: what it has to bring; with an empty one none is asked for.
    """
    if len(line) > LONGEST_LINE_BYTES:
        raise RefusedLineError(f"longer than {LONGEST_LINE_BYTES} bytes")
    try:
        asked: Any = json.loads(line.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise RefusedLineError("not UTF-8") from error
    except (ValueError, RecursionError) as error:
        raise RefusedLineError("not JSON") from error
    if not isinstance(asked, dict):
        raise RefusedLineError("not a JSON object")
    # ascii(): half a surrogate pair is a text to JSON, and no record can hold it.
    if extra := sorted(ascii(key)[1:-1] for key in set(asked) - _KEYS):
        raise RefusedLineError(f"unknown keys: {', '.join(extra)[:_LONGEST_WHO]}")
    if token and not same_token(asked.get("token"), token):
        raise RefusedLineError("wrong token" if "token" in asked else "a token is needed")
    command = asked.get("command")
    if not isinstance(command, str) or command not in _WORDS:
        raise RefusedLineError(f"command is one of {', '.join(_WORDS)}")
    who = checked_who(asked.get("who", "operator"))
    if command in _QUERIES:
        return cast("Query", command)
    return _command(cast("OperatorKind", command), who, asked)


def _command(kind: OperatorKind, who: str, asked: Mapping[str, Any]) -> OperatorCommand:
    """Return the operator command of a parsed line. Raises RefusedLineError."""
    if kind != "geofence":
        node, bench = asked.get("node", ""), asked.get("bench", "")
        if not isinstance(node, str) or not isinstance(bench, str):
            raise RefusedLineError("node and bench are names")
        if kind != "abort" and (node or bench):
            raise RefusedLineError(f"{kind}: node and bench are for abort alone")
        return OperatorCommand(kind, who, node=node, bench=bench)
    document, command_id = asked.get("geofence"), asked.get("id")
    if not isinstance(document, str) or not isinstance(command_id, str):
        raise RefusedLineError("geofence is the text of a file, and id anything not used before")
    return OperatorCommand("geofence", who, document=document, command_id=command_id)


def checked_who(who: Any) -> str:
    """Return an operator's name that is fit for the record. Raises RefusedLineError."""
    if not isinstance(who, str) or not 1 <= len(who) <= _LONGEST_WHO or not who.isprintable():
        raise RefusedLineError(f"who is a name of 1 to {_LONGEST_WHO} printable characters")
    return who


def same_token(given: Any, token: str) -> bool:
    """Return whether an operator's token is right, in constant time."""
    return isinstance(given, str) and hmac.compare_digest(
        given.encode("utf-8", "replace"), token.encode()
    )


def answer(*, ok: bool, text: str, command: str = "", **details: Any) -> bytes:
    """Return the reply line to an operator."""
    answered = {"ok": ok, "command": command, "text": text, **details}
    return json.dumps(answered, ensure_ascii=False).encode() + b"\n"
