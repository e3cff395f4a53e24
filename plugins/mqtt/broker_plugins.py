"""The embedded broker, and its authentication and topic permissions; needs amqtt.

amqtt loads the plugins by their names.
"""

from asyncio import StreamReader, StreamWriter
from dataclasses import dataclass, field

from amqtt.broker import Broker
from amqtt.contexts import Action as BrokerAction
from amqtt.contexts import BaseContext
from amqtt.plugins.base import BaseAuthPlugin, BaseTopicPlugin
from amqtt.session import Session

from wil_campaign.plugins.mqtt.broker_access import Action, BrokerAccess

_ACTIONS: dict[BrokerAction, Action] = {
    BrokerAction.PUBLISH: "publish",
    BrokerAction.SUBSCRIBE: "subscribe",
    BrokerAction.RECEIVE: "receive",
}


@dataclass
class _Config:
    """base, passwords: as of BrokerAccess."""

    base: str = ""
    passwords: dict[str, str] = field(default_factory=dict)


def _access_of(context: BaseContext) -> BrokerAccess:
    config = context.config
    if not isinstance(config, _Config):
        raise TypeError("the embedded broker was started without users")
    return BrokerAccess(base=config.base, passwords=config.passwords)


class ClosingBroker(Broker):  # type: ignore[misc]  # amqtt is not typed
    """Closes each connection that it is done with.

    amqtt leaves one open that ended before it said who it is, as a look at the port does: in time
    there are no more descriptors.
    """

    async def stream_connected(
        self, reader: StreamReader, writer: StreamWriter, listener_name: str
    ) -> None:
        """Handle a connection to its end."""
        try:
            await super().stream_connected(reader, writer, listener_name)
        finally:
            writer.close()


class CampaignAuth(BaseAuthPlugin):  # type: ignore[misc]  # as above
    """Admits users with a valid password; a last will only for a topic they may publish on."""

    Config = _Config

    def __init__(self, context: BaseContext) -> None:
        super().__init__(context)
        self._access = _access_of(context)

    async def authenticate(self, *, session: Session) -> bool:
        """Return whether a client may connect."""
        if not self._access.admits(session.username, session.password):
            return False
        # The broker publishes a last will without checking topic permissions.
        return not session.will_flag or self._access.permits(
            session.username, "publish", session.will_topic or ""
        )


class CampaignTopics(BaseTopicPlugin):  # type: ignore[misc]  # as above
    """Restricts users to their topics."""

    Config = _Config

    def __init__(self, context: BaseContext) -> None:
        super().__init__(context)
        self._access = _access_of(context)

    async def topic_filtering(
        self,
        *,
        session: Session | None = None,
        topic: str | None = None,
        action: BrokerAction | None = None,
    ) -> bool:
        """Return whether a client may do this with a topic."""
        if session is None or topic is None or action is None:
            return False
        return self._access.permits(session.username, _ACTIONS[action], topic)
