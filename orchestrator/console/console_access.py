"""Who may see and command by a console: one-time tokens, sessions, who has control; pure.

A token stands in the fragment of a link, is used once, and is exchanged for a session, which a
cookie carries. An operator's session may command while it has control; abort is every operator's.
"""

import hmac
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from safety.guard.core.operator_command import OperatorKind

Role = Literal["operator", "viewer"]
MAX_TOKENS = 32
"""Links that are not used yet; the oldest yields."""
MAX_SESSIONS = 64
_TOKEN_BYTES = 24


@dataclass(frozen=True, slots=True)
class Session:
    """A session of a console's page. number: for people, in the order of arrival; name: of whom."""

    key: str
    number: int
    role: Role
    name: str


class AccessError(Exception):
    """A request that is refused; says why."""


class ConsoleAccess:
    """The access to one console: its tokens, its sessions, and which of them has control."""

    def __init__(
        self, *, new_token: Callable[[], str] = lambda: secrets.token_urlsafe(_TOKEN_BYTES)
    ) -> None:
        self._new_token = new_token
        self._tokens: dict[str, Role] = {}
        self._sessions: dict[str, Session] = {}
        self._count = 0
        self.in_control: Session | None = None

    def invite(self, role: Role) -> str:
        """Return a new one-time token for a link."""
        if len(self._tokens) >= MAX_TOKENS:
            del self._tokens[next(iter(self._tokens))]
        token = self._new_token()
        self._tokens[token] = role
        return token

    def begin(self, token: str, name: str) -> Session:
        """Return the session that a token is good for; the token is used up. Raises AccessError."""
        known = next((one for one in self._tokens if _is_same(one, token)), None)
        if known is None:
            raise AccessError(
                "this link was used already, or is wrong: ask for a new one at the console's "
                "terminal or page"
            )
        if len(self._sessions) >= MAX_SESSIONS:
            raise AccessError(f"{MAX_SESSIONS} sessions are open already; restart the console")
        role = self._tokens.pop(known)
        self._count += 1
        session = Session(self._new_token(), self._count, role, name)
        self._sessions[session.key] = session
        if role == "operator" and self.in_control is None:
            self.in_control = session
        return session

    def session(self, key: str) -> Session:
        """Return the session of a cookie. Raises AccessError."""
        for known, session in self._sessions.items():
            if _is_same(known, key):
                return session
        raise AccessError("no session: open the link that the terminal shows")

    def take_control(self, session: Session) -> None:
        """Give an operator's session control, whoever had it. Raises AccessError."""
        if session.role != "operator":
            raise AccessError("a viewer cannot take control: ask for an operator's link")
        self.in_control = session

    def require_command(self, session: Session, kind: OperatorKind) -> None:
        """Raise AccessError unless a session may give a command now."""
        if session.role != "operator":
            raise AccessError(f"{kind}: a viewer commands nothing; ask for an operator's link")
        if kind == "abort" or session == self.in_control:
            return
        holder = "nobody" if self.in_control is None else self.in_control.name
        raise AccessError(f"{kind}: {holder} has control; take control first")


def _is_same(one: str, other: str) -> bool:
    """Return whether two secrets are the same, in constant time."""
    return hmac.compare_digest(one.encode(), other.encode("utf-8", "replace"))
