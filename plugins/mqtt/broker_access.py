"""Users, passwords and topic permissions of a campaign's embedded MQTT broker; pure."""

import hmac
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Self, get_args

from wil_campaign.safety.guard.core.operator_command import OperatorKind

Action = Literal["publish", "subscribe", "receive"]
CAMPAIGN, OPERATOR, WATCHER = "wil", "operator", "watcher"


@dataclass(frozen=True, slots=True, kw_only=True)
class BrokerAccess:
    """The users of an embedded broker. base: the prefix of its topics; passwords: by user.

    The campaign may do everything beneath base. The operator may subscribe to it and publish
    commands. The watcher may subscribe to it. No user may use any other topic, and a user without
    a password may not connect.
    """

    base: str
    passwords: Mapping[str, str]

    @classmethod
    def new(cls, base: str) -> Self:
        """Return users with new passwords."""
        users = (CAMPAIGN, OPERATOR, WATCHER)
        return cls(base=base, passwords={user: secrets.token_urlsafe(18) for user in users})

    def admits(self, user: str | None, password: str | None) -> bool:
        """Return whether a user with this password may connect."""
        wanted = self.passwords.get(user or "", "")
        given = (password or "").encode("utf-8", "replace")
        return bool(wanted) and hmac.compare_digest(given, wanted.encode())

    def permits(self, user: str | None, action: Action, topic: str) -> bool:
        """Return whether a user may do this. topic: for a subscription a filter."""
        if user not in self.passwords or not topic.startswith(f"{self.base}/"):
            return False
        if user == CAMPAIGN or action != "publish":
            return True
        return user == OPERATOR and topic in self._command_topics()

    def _command_topics(self) -> tuple[str, ...]:
        return tuple(f"{self.base}/operator/{kind}" for kind in get_args(OperatorKind))
