"""Who may do what at the embedded broker: users and passwords of one campaign; pure."""

import hmac
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Self, get_args

from safety.guard.core.operator_command import OperatorKind

Action = Literal["publish", "subscribe", "receive"]
CAMPAIGN, OPERATOR, WATCHER = "wil", "operator", "watcher"


@dataclass(frozen=True, slots=True, kw_only=True)
class BrokerAccess:
    """The users of a campaign's own broker. base: above its topics; passwords: by user.

    The campaign may do everything beneath base. The operator reads it, and publishes commands. The
    watcher reads it. Nobody reaches any other topic, and a name without a password is nobody.
    """

    base: str
    passwords: Mapping[str, str]

    @classmethod
    def new(cls, base: str) -> Self:
        """Return users with new passwords."""
        users = (CAMPAIGN, OPERATOR, WATCHER)
        return cls(base=base, passwords={user: secrets.token_urlsafe(18) for user in users})

    def admits(self, user: str | None, password: str | None) -> bool:
        """Return whether somebody may connect."""
        wanted = self.passwords.get(user or "", "")
        given = (password or "").encode("utf-8", "replace")
        return bool(wanted) and hmac.compare_digest(given, wanted.encode())

    def permits(self, user: str | None, action: Action, topic: str) -> bool:
        """Return whether a user may do this. topic: or a filter, for a subscription."""
        if user not in self.passwords or not topic.startswith(f"{self.base}/"):
            return False
        if user == CAMPAIGN or action != "publish":
            return True
        return user == OPERATOR and topic in self._command_topics()

    def _command_topics(self) -> tuple[str, ...]:
        return tuple(f"{self.base}/operator/{kind}" for kind in get_args(OperatorKind))
