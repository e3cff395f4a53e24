"""Parses and authenticates MQTT commands; refuses invalid ones with a reason; pure.

A command is a JSON object on <root>/<campaign>/operator/{abort,hold,resume,geofence}:

    {"session": "20261121T153936Z", "id": "a1", "at": 1763739601.2, "who": "anna",
     "signature": "..."}

signature: by the operators' token, see message_signing; absent where a campaign has `commands:
unsigned`. session: the start of the campaign that is meant, as in `status`. id: a text that is
never used twice. at: seconds since 1970. run: "case/mode/repetition", when only that run is meant;
it must be in flight. An abort lands all runs, whatever run it names. geofence, only for the command
of that name: an object as in a campaign, a QGroundControl plan, GeoJSON, or the text of a file with
one of them.
"""

import json
from collections.abc import Callable, Collection
from typing import Any, cast, get_args

from wil_campaign.foundation.files.problems import is_encodable
from wil_campaign.plugins.mqtt.message_signing import SignatureError, command_key, verified_message
from wil_campaign.safety.guard.core.operator_command import OperatorCommand, OperatorKind
from wil_campaign.safety.guard.operator.operator_lines import (
    RefusedLineError,
    checked_operator_name,
)

LONGEST_COMMAND_BYTES = 1 << 16
OLDEST_S = 5.0
_LONGEST_ID = 64
_LONGEST_REASON = 200
_KEYS = frozenset({"session", "id", "at", "who", "run", "reason", "geofence"})
_KINDS: frozenset[str] = frozenset(get_args(OperatorKind))


class RefusedCommandError(Exception):
    """A refused MQTT command, with the reason. command_id, who: empty if they were not read."""

    def __init__(self, reason: str, *, command_id: str = "", who: str = "") -> None:
        super().__init__(reason)
        self.command_id = command_id
        self.who = who


class CommandReader:
    """Reads one campaign's MQTT commands; remembers ids, so that none runs twice.

    base: the prefix of the campaign's topics. token: the key of signatures; None where commands are
    not signed. flying: returns the runs in flight.
    """

    def __init__(
        self,
        *,
        base: str,
        token: str | None,
        session: str,
        flying: Callable[[], Collection[str]],
    ) -> None:
        if token == "":
            raise ValueError("with an empty token anybody could sign commands")
        self._base = base
        self._key = None if token is None else command_key(token)
        self._session = session
        self._flying = flying
        self._seen: dict[str, float] = {}

    def read(self, kind: str, payload: bytes, *, retained: bool, now_s: float) -> OperatorCommand:
        """Return the command in an MQTT message. now_s: since 1970. Raises RefusedCommandError."""
        fields = self._authentic(kind, payload)
        command_id = _id(fields)
        if not command_id:
            raise RefusedCommandError(
                f"id must be a text of 1 to {_LONGEST_ID} printable characters"
            )
        try:
            who = checked_operator_name(fields.get("who", "operator"))
        except RefusedLineError as error:
            raise RefusedCommandError(str(error), command_id=command_id) from error
        reason = self._refusal(kind, fields, retained=retained, now_s=now_s)
        if reason or self._is_known(command_id, now_s):
            raise RefusedCommandError(
                reason or "this id was used already", command_id=command_id, who=who
            )
        why = fields.get("reason", "")
        text = why if isinstance(why, str) and _is_fit(why, _LONGEST_REASON) else ""
        return OperatorCommand(
            cast("OperatorKind", kind),
            f"mqtt:{who}",
            text,
            _document(fields),
            command_id,
            run=self._run(fields),
        )

    def _run(self, fields: dict[str, Any]) -> str:
        """Return the run in flight that an MQTT command names; "?" for another, "" for none."""
        if "run" not in fields:
            return ""
        return next((run for run in self._flying() if run == fields["run"]), "?")

    def _authentic(self, kind: str, payload: bytes) -> dict[str, Any]:
        """Return the command's object after checking its signature. Raises RefusedCommandError."""
        fields = _object(payload)
        if self._key is None:
            return fields
        try:
            body = verified_message(f"{self._base}/operator/{kind}", payload, self._key)
        except SignatureError as error:
            raise RefusedCommandError(str(error), command_id=_id(fields)) from error
        # Only the signed bytes: a parser may read more into the whole message.
        return _object(body)

    def _refusal(self, kind: str, fields: dict[str, Any], *, retained: bool, now_s: float) -> str:
        """Return why an authorised MQTT command is refused; empty when it is not."""
        unknown = sorted(ascii(key)[1:-1] for key in set(fields) - _KEYS)
        checks = (
            (bool(unknown), f"unknown keys: {', '.join(unknown)[:_LONGEST_ID]}"),
            (kind not in _KINDS, f"there is no command '{kind[:_LONGEST_ID]}'"),
            (retained, "it was retained by the broker: publish commands without retain"),
            (not _is_time(fields.get("at")), "at must be the time in seconds since 1970"),
            (
                not _is_fresh(fields.get("at"), now_s),
                f"stale: more than {OLDEST_S:g} s old, or the clocks differ by as much",
            ),
            (
                fields.get("session") != self._session,
                f"for another session of the campaign; the session is {self._session}",
            ),
            (
                ("geofence" in fields) != (kind == "geofence"),
                "geofence is required for the command geofence, and only there",
            ),
            (not is_encodable(_document(fields)), "geofence must be a text of whole characters"),
            (
                # An abort is for all runs, and is not refused for naming one that has just ended.
                kind != "abort" and self._run(fields) == "?",
                "for a run that is not in flight",
            ),
        )
        return next((text for wrong, text in checks if wrong), "")

    def _is_known(self, command_id: str, now_s: float) -> bool:
        """Return whether a command's id is known, and remember it; old ones are dropped."""
        self._seen = {one: t_s for one, t_s in self._seen.items() if now_s - t_s < 3.0 * OLDEST_S}
        known = command_id in self._seen
        self._seen.setdefault(command_id, now_s)
        return known


def _object(payload: bytes) -> dict[str, Any]:
    if len(payload) > LONGEST_COMMAND_BYTES:
        raise RefusedCommandError(f"longer than {LONGEST_COMMAND_BYTES} bytes")
    try:
        fields = json.loads(payload.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise RefusedCommandError("not UTF-8") from error
    except (ValueError, RecursionError) as error:
        raise RefusedCommandError("not JSON") from error
    if not isinstance(fields, dict):
        raise RefusedCommandError("not a JSON object")
    return fields


def _is_time(at_s: Any) -> bool:
    return isinstance(at_s, int | float) and not isinstance(at_s, bool)


def _is_fresh(at_s: Any, now_s: float) -> bool:
    # These comparisons are false for NaN, and accept integers beyond the range of floats.
    return _is_time(at_s) and now_s - OLDEST_S <= at_s <= now_s + OLDEST_S


def _id(fields: dict[str, Any]) -> str:
    """Return an MQTT command's id; empty when it is missing or not printable."""
    value = fields.get("id")
    return value if isinstance(value, str) and _is_fit(value, _LONGEST_ID) else ""


def _document(fields: dict[str, Any]) -> str:
    given = fields.get("geofence", "")
    return given if isinstance(given, str) else json.dumps(given)


def _is_fit(text: str, longest: int) -> bool:
    return len(text) <= longest and text.isprintable()
