"""MQTT client of a campaign: publishes reports and receives commands; reconnects by itself."""

import asyncio
import random
import re
import secrets
import ssl
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass

import aiomqtt

from wil_campaign.foundation.tasks import (
    FAULTS,
    SuppressedErrors,
    is_task_cancellation,
    leaf_errors,
    raise_if_task_cancelled,
    report_task_error,
    start_task,
    stop_tasks,
)
from wil_campaign.orchestrator.operator.campaign_controller import CampaignController
from wil_campaign.orchestrator.operator.errors import OperatingError
from wil_campaign.orchestrator.operator.run_messages import News
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.mqtt.message_signing import signed_message, status_key
from wil_campaign.plugins.mqtt.mqtt_answers import CommandAnswers
from wil_campaign.plugins.mqtt.mqtt_commands import CommandReader, RefusedCommandError
from wil_campaign.plugins.mqtt.mqtt_reports import (
    acknowledgement_publication,
    publications_of_news,
    session_in_flight,
    status_publication,
    verdict_publication,
)
from wil_campaign.plugins.mqtt.mqtt_setup import MqttSetup
from wil_campaign.plugins.mqtt.outbox import PublicationOutbox
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.operator.operator_lines import RefusedLineError
from wil_campaign.safety.guard.operator.rate_limit import RateLimit

_CONNECT_S = 5.0
_KEEPALIVE_S = 5
_OF_SILENCE = re.compile(r"timed out|keep ?alive", re.IGNORECASE)
"""Why a connection ends whose broker says nothing more: it was away for _CONNECT_S by then."""
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.5, 15.0
_FLUSH_S = 3.0
_QUIET_LOOKS = 5
_MOST_REFUSALS_A_SECOND = 10
_REFUSED = 0x80
"""From here on the codes of a SUBACK are refusals; those below are the granted quality."""
_LOSS = "mqtt (the broker is away)"
_CONNECTION_ERRORS = (aiomqtt.MqttError, OperatingError, OSError, UnicodeError)
"""Errors of aiomqtt caused by the broker or the network; any other is a bug of this program."""


@contextmanager
def _connected() -> Iterator[None]:
    """Convert MqttError at the end of a connection to OperatingError, an error of this package."""
    try:
        yield
    except aiomqtt.MqttError as error:
        raise OperatingError(_error_text(error)) from error


@dataclass(frozen=True, slots=True, kw_only=True)
class MqttSecrets:
    """The secrets of MQTT: the command token, and the broker's password (empty for none).

    token: None where neither commands nor publications are signed.
    """

    token: str | None
    password: str = ""


@asynccontextmanager
async def connected_mqtt_operator(
    setup: MqttSetup, secrets_: MqttSecrets, controller: CampaignController
) -> AsyncIterator[None]:
    """Connect a campaign controller to an MQTT broker for the context's duration.

    Raises OperatingError when the first connection fails; a connection that is lost later is made
    again.
    """
    client = MqttOperator(setup=setup, secrets_=secrets_, controller=controller)
    running = start_task(client.run(), name="mqtt")
    try:
        await client.first_connection(running)
        yield
        await client.finish()
    finally:
        try:
            await stop_tasks(running)
        finally:
            client.close()


_OF_OPENSSL = re.compile(r"^\[SSL: \w+\] | \(_ssl\.c:\d+\)$")


class MqttOperator:
    """The MQTT client of one campaign. jitter: a random share of each wait to reconnect."""

    def __init__(
        self,
        *,
        setup: MqttSetup,
        secrets_: MqttSecrets,
        controller: CampaignController,
        utc: Callable[[], float] = time.time,
        jitter: Callable[[], float] = random.random,
    ) -> None:
        self._setup = setup
        self._secrets = secrets_
        self._controller = controller
        self._utc = utc
        self._jitter = jitter
        self._base = f"{setup.root}/{controller.campaign}"
        self._reader = CommandReader(
            base=self._base,
            token=secrets_.token,
            session=controller.session,
            flying=lambda: controller.flying,
        )
        self._status_key = None if secrets_.token is None else status_key(secrets_.token)
        self._outbox = PublicationOutbox()
        self._first: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._loss_timer: asyncio.TimerHandle | None = None
        self._connected = False
        self._has_ended = False
        self._has_warned = False
        self._has_asked_status = False
        self._is_publishing = False
        self._refusals = RateLimit(most=_MOST_REFUSALS_A_SECOND)
        self._answers = CommandAnswers(
            acknowledged=lambda: controller.acknowledged, answer=self._answer_command
        )

    async def first_connection(self, running: asyncio.Task[None]) -> None:
        """Wait for the first connection to the broker. Raises OperatingError.

        running: the task of `run`, which may end before that.
        """
        await asyncio.wait({running, self._first}, return_when=asyncio.FIRST_COMPLETED)
        if not self._first.done():
            raise OperatingError("the MQTT client ended before it was connected; see log.jsonl")
        await self._first
        self._controller.follow(self)

    async def run(self) -> None:
        """Stay connected to the MQTT broker until cancelled.

        A bug in this client stops no flight either: it is reported, and the client reconnects.
        """
        wait_s = _FIRST_WAIT_S
        while True:
            # A task for each: in Python 3.11 one whose TaskGroup failed counts as cancelled after.
            why = await start_task(self._connection(), name="mqtt connection")
            raise_if_task_cancelled()
            if not self._first.done():
                self._first.set_exception(self._unreachable(why))
                return
            wait_s = _FIRST_WAIT_S if self._connected else min(2.0 * wait_s, _LONGEST_WAIT_S)
            with SuppressedErrors("mqtt"):
                self._disconnected(why)
            await asyncio.sleep(wait_s * (0.5 + 0.5 * self._jitter()))

    async def _connection(self) -> str:
        """Connect once to the MQTT broker; return why the connection ended.

        Before the first connection `first_connection` raises the error, so it is not reported.
        """
        try:
            await self._keep_connected()
        except (*FAULTS, BaseExceptionGroup) as error:
            if is_task_cancellation(error):
                raise
            bugs = [
                leave for leave in leaf_errors(error) if not isinstance(leave, _CONNECTION_ERRORS)
            ]
            for base_exception in bugs if self._first.done() else ():
                report_task_error(base_exception, "mqtt")
            return _error_text(error)
        return "the connection ended"

    async def finish(self) -> None:
        """Publish the last status, and wait a moment for pending MQTT messages.

        Over a slow link the events before it are given up: the broker keeps the status for ever.
        """
        self._has_ended = True
        self.status()
        if not await self._flushed():
            self._outbox.keep_newest_status()
            await self._flushed()

    async def _flushed(self) -> bool:
        """Wait until all is acknowledged, or nobody is connected; return False when time is up.

        A socket that is closed with unread answers is reset, upon which the broker may publish the
        last will in place of the last status.
        """
        loop = asyncio.get_running_loop()
        deadline_s, quiet = loop.time() + _FLUSH_S, 0
        while self._connected and quiet < _QUIET_LOOKS:
            if loop.time() >= deadline_s:
                return False
            await asyncio.sleep(0.01)
            quiet = quiet + 1 if self._outbox.empty and not self._is_publishing else 0
        return True

    def close(self) -> None:
        """Cancel the timers of a lost broker and of awaited acknowledgements."""
        self._answers.close()
        if self._loss_timer is not None:
            self._loss_timer.cancel()

    def news(self, news: News) -> None:
        """Publish a run's news by MQTT."""
        for publication in publications_of_news(news):
            self._outbox.put(publication)
        self._answers.update()

    def finished(self, result: RunResult) -> None:
        """Publish a verdict by MQTT."""
        self._outbox.put(verdict_publication(result))
        self._answers.update()

    def status(self) -> None:
        """Publish the campaign's status by MQTT."""
        self._answers.update()
        state = "ended" if self._has_ended else self._controller.state
        self._outbox.put(status_publication(self._controller.summary(state)))

    async def _keep_connected(self) -> None:
        will = status_publication({"state": "lost", "session": self._controller.session})
        will_topic = f"{self._base}/{will.topic}"
        client = aiomqtt.Client(
            self._setup.broker.host,
            self._setup.broker.port,
            username=self._setup.user or None,
            password=self._secrets.password or None,
            identifier=f"wil-{secrets.token_hex(6)}",
            will=aiomqtt.Will(will_topic, self._sign(will_topic, will.payload), 1, True),
            timeout=_CONNECT_S,
            keepalive=_KEEPALIVE_S,
            tls_params=self._tls(),
        )
        async with client:
            await _subscribe(client, f"{self._base}/operator/+")
            await self._watch_status(client)
            raise_if_task_cancelled()
            self._reconnected()
            async with asyncio.TaskGroup() as group:
                group.create_task(self._publish(client), name="mqtt out")
                group.create_task(self._receive_commands(client), name="mqtt in")

    async def _watch_status(self, client: aiomqtt.Client) -> None:
        """Subscribe to the status, once, to learn of another start of this campaign.

        A broker may refuse it, and some end the connection for that: the next one goes without.
        """
        if not self._has_asked_status:
            self._has_asked_status = True
            await client.subscribe(f"{self._base}/status", qos=1)

    def _tls(self) -> aiomqtt.TLSParameters | None:
        setup = self._setup
        if not setup.broker.tls:
            return None
        return aiomqtt.TLSParameters(
            ca_certs=None if setup.ca_file is None else str(setup.ca_file),
            certfile=None if setup.cert_file is None else str(setup.cert_file),
            keyfile=None if setup.key_file is None else str(setup.key_file),
            cert_reqs=ssl.CERT_REQUIRED,
        )

    def _sign(self, topic: str, payload: bytes) -> bytes:
        """Return a payload with its time, which shows whether it is old, and its signature."""
        if self._status_key is None:
            return payload
        at = f', "at": {round(self._utc(), 3)}}}'
        return signed_message(topic, payload[:-1] + at.encode(), self._status_key)

    async def _publish(self, client: aiomqtt.Client) -> None:
        while True:
            publication = await self._outbox.take()
            topic = f"{self._base}/{publication.topic}"
            self._is_publishing = True
            try:
                with _connected():
                    await client.publish(
                        topic,
                        self._sign(topic, publication.payload),
                        qos=1 if publication.important else 0,
                        retain=publication.retain,
                    )
            except (OperatingError, asyncio.CancelledError):
                # Cancelled also when the connection was lost before the broker answered.
                self._outbox.put_back(publication)
                raise
            finally:
                self._is_publishing = False
            raise_if_task_cancelled()

    async def _receive_commands(self, client: aiomqtt.Client) -> None:
        with _connected():
            async for message in client.messages:
                kind = str(message.topic).rpartition("/")[2]
                payload = message.payload if isinstance(message.payload, bytes) else b""
                if str(message.topic) == f"{self._base}/status":
                    self._receive_status(payload)
                elif kind != "ack":
                    self._execute_command(kind, payload, retained=bool(message.retain))

    def _receive_status(self, payload: bytes) -> None:
        """Warn, once, of another start of this campaign in flight that has the same topics."""
        other = session_in_flight(payload)
        if self._has_warned or other in {"", self._controller.session}:
            return
        self._has_warned = True
        self._controller.warn(
            f"the broker has the status of another start of this campaign, {other}: if that flies "
            f"too, each replaces the other's reports at {self._base}/, and operators must give the "
            "session of the one that they mean; set another operator.mqtt.root"
        )

    def _execute_command(self, kind: str, payload: bytes, *, retained: bool) -> None:
        try:
            command = self._reader.read(kind, payload, retained=retained, now_s=self._utc())
        except RefusedCommandError as error:
            self._refuse(kind, error)
            return
        try:
            text = self._obey(command)
        except RefusedLineError as error:
            self._answers.refused(command, str(error))
        else:
            self._answers.obeyed(command, text)

    def _obey(self, command: OperatorCommand) -> str:
        """Execute a command; return what was done. Raises RefusedLineError, also after the end."""
        if self._has_ended:  # else the last status, which the broker keeps, would be another
            raise RefusedLineError(f"{command.kind}: the campaign has ended")
        return self._controller.obey(command)

    def _refuse(self, kind: str, error: RefusedCommandError) -> None:
        if self._refusals.is_exceeded(asyncio.get_running_loop().time()):
            return  # A client that floods gets no answers, and does not fill the disk.
        self._controller.log.refused(f"mqtt: {kind}: {error}", who=error.who)
        self._answer(
            id=error.command_id, command=kind, ok=False, text=str(error), who=error.who, final=True
        )

    def _answer_command(
        self, command: OperatorCommand, *, ok: bool, text: str, final: bool
    ) -> None:
        kind, who, number = command.kind, command.who, command.command_id
        self._answer(id=number, command=kind, ok=ok, text=text, who=who, final=final)

    def _answer(self, **fields: str | bool) -> None:
        self._outbox.put(acknowledgement_publication(session=self._controller.session, **fields))

    def _reconnected(self) -> None:
        if self._first.done():
            self._controller.log.note("reconnected to the MQTT broker")
        else:
            self._first.set_result(None)
        if self._loss_timer is not None:
            self._loss_timer.cancel()
            self._loss_timer = None
        self._connected = True
        self.status()

    def _disconnected(self, why: str) -> None:
        if not self._connected:
            return
        self._connected = False
        self._controller.log.note(f"the MQTT broker is disconnected: {why}")
        loop = asyncio.get_running_loop()
        silent_s = _CONNECT_S if _OF_SILENCE.search(why) else 0.0
        left_s = max(0.0, self._setup.lost_after_s - silent_s)
        self._loss_timer = loop.call_later(left_s, self._disconnected_too_long)

    def _disconnected_too_long(self) -> None:
        kind = self._setup.on_loss
        if kind == "continue":
            return
        command = OperatorCommand(kind, _LOSS)
        try:
            self._controller.obey(command)
        except RefusedLineError:
            return  # The campaign is held or landing already; the log says so.

    def _unreachable(self, why: str) -> OperatingError:
        broker = self._setup.broker
        if broker.tls and "timed out" in why:
            why += "; it may require a client certificate"
        return OperatingError(
            f"cannot connect to the MQTT broker {broker}: {why}; start it, correct "
            "operator.mqtt of the campaign, or fly without --broker"
        )


async def _subscribe(client: aiomqtt.Client, topics: str) -> None:
    """Subscribe to the topics of commands. Raises OperatingError where the broker refuses it.

    Its refusal is an answer like any other: without this check no command would ever come.
    """
    for granted in await client.subscribe(topics, qos=1):
        if (granted if isinstance(granted, int) else granted.value) >= _REFUSED:
            raise OperatingError(
                f"it does not let this user subscribe to {topics}, where commands come"
            )


def _error_text(error: BaseException) -> str:
    """Return the text of an MQTT connection error, without the source line of OpenSSL."""
    error = leaf_errors(error)[0]
    return _OF_OPENSSL.sub("", str(error)) or type(error).__name__
