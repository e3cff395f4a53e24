"""Access to a console: one-time tokens, sessions, and which session has control; pure.

A token is in the fragment of a link. It is valid once, and exchanged for a session, which is kept
in a cookie. An operator's session may command while it has control; every operator may abort.
"""

import hmac
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from wil_campaign.safety.guard.core.operator_command import OperatorKind

Role = Literal["operator", "viewer"]
MAX_TOKENS = 32
"""Unused links; a new one replaces the oldest."""
MAX_SESSIONS = 64
_TOKEN_BYTES = 24


@dataclass(frozen=True, slots=True)
class ConsoleSession:
    """A session of a console's page. number: in the order of arrival; name: of the person."""

    key: str
    number: int
    role: Role
    name: str


class AccessError(Exception):
    """A request is refused; the message says why."""


class ConsoleAccess:
    """The access to one console: its tokens, its sessions, and which of them has control."""

    def __init__(
        self, *, new_token: Callable[[], str] = lambda: secrets.token_urlsafe(_TOKEN_BYTES)
    ) -> None:
        self._new_token = new_token
        self._tokens: dict[str, Role] = {}
        self._sessions: dict[str, ConsoleSession] = {}
        self._count = 0
        self.in_control: ConsoleSession | None = None

    def invite(self, role: Role) -> str:
        """Return a new one-time token for a link."""
        if len(self._tokens) >= MAX_TOKENS:
            del self._tokens[next(iter(self._tokens))]
        token = self._new_token()
        self._tokens[token] = role
        return token

    def begin(self, token: str, name: str) -> ConsoleSession:
        """Exchange a one-time token for a new session. Raises AccessError."""
        known = next((one for one in self._tokens if _is_same(one, token)), None)
        if known is None:
            raise AccessError(
                "this link is invalid or was already used: get a new one from the console's "
                "terminal or page"
            )
        if len(self._sessions) >= MAX_SESSIONS:
            raise AccessError(f"{MAX_SESSIONS} sessions are open already; restart the console")
        role = self._tokens.pop(known)
        self._count += 1
        session = ConsoleSession(self._new_token(), self._count, role, name)
        self._sessions[session.key] = session
        if role == "operator" and self.in_control is None:
            self.in_control = session
        return session

    def session(self, key: str) -> ConsoleSession:
        """Return the session of a cookie. Raises AccessError."""
        for known, session in self._sessions.items():
            if _is_same(known, key):
                return session
        raise AccessError("no session: open the link that the terminal shows")

    def take_control(self, session: ConsoleSession) -> None:
        """Give control to an operator's session, whichever session had it. Raises AccessError."""
        if session.role != "operator":
            raise AccessError("a viewer cannot take control: open an operator's link")
        self.in_control = session

    def require_command(self, session: ConsoleSession, kind: OperatorKind) -> None:
        """Raise AccessError unless a session may give a command now."""
        if session.role != "operator":
            raise AccessError(f"{kind}: a viewer cannot command: open an operator's link")
        if kind == "abort" or session == self.in_control:
            return
        holder = "nobody" if self.in_control is None else self.in_control.name
        raise AccessError(f"{kind}: {holder} has control; take control first")


def _is_same(one: str, other: str) -> bool:
    """Return whether two secrets are the same, in constant time."""
    return hmac.compare_digest(one.encode(), other.encode("utf-8", "replace"))
