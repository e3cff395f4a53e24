"""Serves the Foxglove WebSocket protocol by its SDK; clients can only receive.

The SDK sends in its own threads; for a slow client it drops the oldest messages.
"""

from types import TracebackType
from typing import TYPE_CHECKING, Self

from wil_campaign.orchestrator.recording.mcap.mcap_encode import McapChannel, McapMessage
from wil_campaign.orchestrator.recording.mcap.mcap_schemas import mcap_schema_texts, schema_of_class
from wil_campaign.plugins.console.console_address import ConsoleAddress
from wil_campaign.plugins.foxglove.errors import BridgeError
from wil_campaign.plugins.foxglove.live_messages import ALWAYS, RUN, RunStateMessage

if TYPE_CHECKING:  # of an extra
    import foxglove
    from foxglove.websocket import WebSocketServer

_BACKLOG = 512
"""Queued messages per client: some seconds of a flight, some 20 MB."""


class FoxgloveServer:
    """Serves the messages of run.mcap at an address; a context manager.

    Raises BridgeError if the extra is not installed, or the address is not available.
    """

    def __init__(self, address: ConsoleAddress) -> None:
        self._address = address
        self._channels: dict[McapChannel, foxglove.Channel] = {}
        self._server: WebSocketServer | None = None

    def __enter__(self) -> Self:
        try:
            import foxglove  # noqa: PLC0415  # of an extra
            from foxglove.websocket import Capability  # noqa: PLC0415  # of an extra
        except ImportError as error:
            raise BridgeError(
                "--foxglove needs the extra foxglove: pip install 'wil-campaign[foxglove]'"
            ) from error
        self._sdk, self._context = foxglove, foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name="wil-campaign",
                host=self._address.host,
                port=self._address.port,
                # Clients get the run's time. All other capabilities would let them act.
                capabilities=[Capability.Time],
                context=self._context,
                message_backlog_size=_BACKLOG,
            )
        except (RuntimeError, OSError) as error:
            raise BridgeError(
                f"cannot serve Foxglove at {self._address.shown}: {error}; give another address: "
                "--foxglove :PORT"
            ) from error
        for channel in ALWAYS:
            self._channel(channel)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        if self._server is not None:
            self._server.stop()

    @property
    def url(self) -> str:
        """Return the URL to open in Foxglove."""
        assert self._server is not None  # noqa: S101 - it was entered
        host = self._address.shown.rpartition(":")[0]
        return f"ws://{host}:{self._server.port}"

    def begin(self, run: str) -> None:
        """Clear the clients' data: another run begins, with its own times."""
        if self._server is not None:
            self._server.clear_session(run)

    def show_time(self, ns: int) -> None:
        """Send clients the time of the run, in nanoseconds since 1970."""
        if self._server is not None:
            self._server.broadcast_time(ns)

    def send(self, message: McapMessage) -> None:
        """Send a message to all subscribers of its topic, without waiting."""
        self._channel(message.channel).log(message.data, log_time=message.log_ns)

    def _channel(self, channel: McapChannel) -> "foxglove.Channel":
        if channel not in self._channels:
            text = (
                schema_of_class(RUN.schema, RunStateMessage)
                if channel == RUN
                else mcap_schema_texts()[channel.schema]
            )
            self._channels[channel] = self._sdk.Channel(
                channel.topic,
                schema=self._sdk.Schema(name=channel.schema, encoding="jsonschema", data=text),
                message_encoding="json",
                context=self._context,
                metadata={
                    "source": channel.source,
                    "sensor": channel.sensor,
                    "part": channel.part,
                },
            )
        return self._channels[channel]
