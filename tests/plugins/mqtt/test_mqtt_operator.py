"""A desk at a broker: commands and answers, hostile messages, a broker that goes and comes back."""

import asyncio
import json
import socket
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self

import aiomqtt
import pytest

from tests.orchestrator.operator.controllers import FakeFleet, make_controller
from tests.ports import free_port
from wil_campaign.foundation.tasks import TaskAccount
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.operator.campaign_controller import CampaignController
from wil_campaign.orchestrator.operator.errors import OperatingError
from wil_campaign.orchestrator.operator.operator_channels import open_operator_channels
from wil_campaign.orchestrator.operator.run_messages import FlightPlace, RunEventReport
from wil_campaign.plugins.mqtt import mqtt_answers, mqtt_operator
from wil_campaign.plugins.mqtt.broker_access import BrokerAccess
from wil_campaign.plugins.mqtt.broker_address import BrokerAddress
from wil_campaign.plugins.mqtt.embedded_broker import embedded_broker
from wil_campaign.plugins.mqtt.message_signing import signed_command, status_key, verified_message
from wil_campaign.plugins.mqtt.mqtt_operator import (
    MqttOperator,
    MqttSecrets,
    connected_mqtt_operator,
)
from wil_campaign.plugins.mqtt.mqtt_setup import MqttSetup
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

TOKEN = "of the test"  # noqa: S105 - opens nothing
ACCESS = BrokerAccess.new("wil/gate")
SECRETS = MqttSecrets(token=TOKEN, password=ACCESS.passwords["wil"])


class Person:
    """Follows a campaign at a broker, and commands it."""

    def __init__(
        self, port: int, controller: CampaignController, access: BrokerAccess = ACCESS
    ) -> None:
        self._client = aiomqtt.Client(
            "127.0.0.1", port, username="operator", password=access.passwords["operator"]
        )
        self._controller = controller
        self.heard: list[tuple[str, dict[str, Any]]] = []
        self._count = 0

    async def __aenter__(self) -> Self:
        await self._client.__aenter__()
        await self._client.subscribe("wil/gate/#")
        self._task = asyncio.create_task(self._hear())
        return self

    async def __aexit__(self, *error: object) -> None:
        self._task.cancel()
        await asyncio.wait([self._task])
        await self._client.__aexit__(None, None, None)

    async def _hear(self) -> None:
        async for message in self._client.messages:
            assert isinstance(message.payload, bytes)
            topic = str(message.topic).removeprefix("wil/gate/")
            if topic.partition("/")[0] != "operator" or topic.endswith("ack"):
                heard = topic, json.loads(message.payload)
                # One that is published while this client subscribes comes as kept, and as new.
                if topic != "status" or heard not in self.heard:
                    self.heard.append(heard)

    def of(self, topic: str) -> list[dict[str, Any]]:
        return [said for name, said in self.heard if name == topic]

    async def until(self, topic: str, count: int = 1) -> list[dict[str, Any]]:
        async with asyncio.timeout(60.0):
            while len(self.of(topic)) < count:  # noqa: ASYNC110 - another process sets no event
                await asyncio.sleep(0.01)
        return self.of(topic)

    async def say(self, kind: str, payload: bytes, *, retain: bool = False) -> None:
        await self._client.publish(f"wil/gate/operator/{kind}", payload, qos=1, retain=retain)

    async def command(self, kind: str, *, token: str = TOKEN, **changes: Any) -> dict[str, Any]:
        self._count += 1
        body = {"session": self._controller.session, "id": f"id {self._count}"}
        said = {**body, "at": time.time(), "who": "anna", **changes}
        before = len(self._answers(said["id"]))
        await self.say(kind, signed_command(f"wil/gate/operator/{kind}", said, token))
        async with asyncio.timeout(60.0):
            while len(self._answers(said["id"])) <= before:  # noqa: ASYNC110 - as above
                await asyncio.sleep(0.01)
        return self._answers(said["id"])[-1]

    def _answers(self, command_id: str) -> list[dict[str, Any]]:
        return [answer for answer in self.of("operator/ack") if answer["id"] == command_id]


def acknowledge(controller: CampaignController, run: str, kind: str, command_id: str) -> None:
    controller.news(RunEventReport(run, 9.0, "acknowledged", kind, "", "", command_id, "mqtt:anna"))


class Scene:
    """A broker, a desk that is connected to it, and a person."""

    def __init__(self, folder: Path, **setup: Any) -> None:
        self.port = free_port()
        address = BrokerAddress("127.0.0.1", self.port, embedded=True)
        self.setup = MqttSetup(broker=address, **{"user": "wil", **setup})
        self.fleet = FakeFleet()
        self.controller = make_controller(folder, self.fleet)
        self.broker = AsyncExitStack()

    async def start_broker(self) -> None:
        await self.broker.enter_async_context(embedded_broker(self.setup.broker, ACCESS))

    async def stop_broker(self) -> None:
        await self.broker.aclose()

    async def __aenter__(self) -> Self:
        await self.start_broker()
        self._stack = AsyncExitStack()
        await self._stack.enter_async_context(
            connected_mqtt_operator(self.setup, SECRETS, self.controller)
        )
        self.person = await self._stack.enter_async_context(Person(self.port, self.controller))
        return self

    async def __aexit__(self, *error: object) -> None:
        await self._stack.aclose()
        await self.stop_broker()


@pytest.fixture
async def scene(tmp_path: Path) -> AsyncIterator[Scene]:
    async with Scene(tmp_path) as made:
        yield made


def log(folder: Path) -> list[dict[str, Any]]:
    path = folder / "operator.jsonl"
    return [json.loads(line) for line in path.read_text("utf-8").splitlines()]


async def test_commands_are_obeyed_and_answered(scene: Scene, tmp_path: Path) -> None:
    person = scene.person
    (status,) = await person.until("status")
    assert (status["state"], status["session"]) == ("flying", tmp_path.name)
    hold = await person.command("hold")
    assert (hold["ok"], hold["id"], hold["who"]) == (True, "id 1", "mqtt:anna")
    assert hold["text"] == "held: 1 run in flight; no run is started"
    again = await person.command("hold")
    assert (again["ok"], again["text"]) == (False, "hold: all vehicles hold already")
    abort = await person.command("abort")
    assert abort["ok"]
    assert [one.who for one in scene.fleet.aborted] == ["mqtt:anna"]
    assert [said["state"] for said in await person.until("status", 3)] == [
        "flying",
        "held",
        "landing",
    ]
    assert [(one["command"], one["who"], one["ok"]) for one in log(tmp_path)] == [
        ("hold", "mqtt:anna", True),
        ("hold", "mqtt:anna", False),
        ("abort", "mqtt:anna", True),
    ]


@pytest.mark.parametrize("last", ["acknowledged", "over"])
async def test_a_command_is_answered_by_each_run_in_flight(scene: Scene, last: str) -> None:
    controller, person = scene.controller, scene.person
    for number, place in ((1, "first"), (2, "second")):
        controller.begun(f"large/wil/{number}", FlightPlace(place))
    first = await person.command("hold")
    assert (first["ok"], first["final"]) == (True, False)
    acknowledge(controller, "large/wil/2", "hold", first["id"])
    if last == "acknowledged":
        acknowledge(controller, "large/wil/1", "hold", first["id"])
    else:
        controller.left("large/wil/1")
    answers = await person.until("operator/ack", 2)
    assert (answers[-1]["id"], answers[-1]["ok"], answers[-1]["final"]) == (first["id"], True, True)
    by = {
        "acknowledged": "large/wil/2 on second, large/wil/1 on first",
        "over": "large/wil/2 on second",
    }
    assert answers[-1]["text"] == f"acknowledged by {by[last]}"


async def test_a_run_that_does_not_acknowledge_is_named(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mqtt_answers, "WITHIN_S", 0.2)
    controller, person = scene.controller, scene.person
    controller.begun("large/wil/1", FlightPlace("first"))
    controller.begun("large/wil/2", FlightPlace("second"))
    abort = scene.fleet.abort

    def acknowledging(command: OperatorCommand) -> None:
        loop = asyncio.get_running_loop()
        loop.call_soon(acknowledge, controller, "large/wil/2", "abort", command.command_id)
        abort(command)

    monkeypatch.setattr(scene.fleet, "abort", acknowledging)
    first = await person.command("abort")
    assert (first["ok"], first["final"]) == (True, False)
    last = (await person.until("operator/ack", 2))[-1]
    assert (last["ok"], last["final"]) == (False, True)
    assert last["text"] == "not acknowledged within 0.2 s by large/wil/1 on first"


async def test_an_answer_that_is_awaited_is_final_when_another_command_comes(scene: Scene) -> None:
    scene.controller.begun("large/wil/1", FlightPlace("first"))
    held = await scene.person.command("hold")
    await scene.person.command("resume")
    answers = await scene.person.until("operator/ack", 3)
    of_hold = [answer for answer in answers if answer["id"] == held["id"]]
    assert [one["final"] for one in of_hold] == [False, True]
    assert of_hold[-1]["text"].startswith("another command came")


async def test_a_hostile_message_is_refused_and_changes_nothing(
    scene: Scene, tmp_path: Path
) -> None:
    person = scene.person
    for payload in (b"\xff", b"[]", b"{", b"x" * 200_000, b'{"id": "1"}'):
        await person.say("abort", payload)
    answers = await person.until("operator/ack", 5)
    assert [said["ok"] for said in answers] == [False] * 5
    assert [said["text"] for said in answers] == [
        "not UTF-8",
        "not a JSON object",
        "not JSON",
        "longer than 65536 bytes",
        "a signature is needed, as the last member of the object (see docs/operator.md)",
    ]
    stale = await person.command("abort", at=time.time() - 30.0)
    assert stale["text"].startswith("stale")
    other = await person.command("abort", session="20200101T000000Z")
    assert other["text"].startswith("for another session")
    forged = await person.command("abort", token="guess")  # noqa: S106
    assert forged["text"] == "wrong signature"
    await person.say("explode", b"{}")
    assert scene.fleet.aborted == []
    good = await person.command("hold", id="once")
    twice = await person.command("resume", id="once")
    assert (good["ok"], twice["text"]) == (True, "this id was used already")
    refused = [one["text"] for one in log(tmp_path) if not one["ok"]]
    assert "mqtt: abort: wrong signature" in refused


async def test_a_retained_command_is_refused_at_once(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    await scene.start_broker()
    async with Person(scene.port, scene.controller) as person:
        body = {"session": scene.controller.session, "id": "1", "at": time.time()}
        payload = signed_command("wil/gate/operator/abort", body, TOKEN)
        await person.say("abort", payload, retain=True)
        async with connected_mqtt_operator(scene.setup, SECRETS, scene.controller):
            answer = (await person.until("operator/ack"))[0]
    assert answer["text"].startswith("it was retained")
    assert scene.fleet.aborted == []
    await scene.stop_broker()


async def test_a_flood_is_not_answered_and_a_command_gets_through(
    scene: Scene, tmp_path: Path
) -> None:
    person = scene.person
    began_s = time.monotonic()
    for _ in range(500):
        await person.say("abort", b"{")
    await asyncio.sleep(1.1)
    answer = await person.command("abort")
    assert answer["ok"]
    assert len(scene.fleet.aborted) == 1
    # Ten refusals a second are logged, however long the flood takes.
    took_s = time.monotonic() - began_s
    assert len(log(tmp_path)) < 30 + 11 * took_s


async def test_an_event_is_published_at_once(scene: Scene) -> None:
    await scene.person.until("status")
    for follower in (scene.controller,):
        follower.news(
            RunEventReport("large/wil/1", 9.0, "collision", "collision", "real", "touched")
        )
        follower.news(RunEventReport("large/wil/1", 9.0, "decisive", "FAIL", "", "a contact"))
    (touch,) = await scene.person.until("collision")
    (verdict,) = await scene.person.until("verdict")
    assert (touch["vehicle"], verdict["verdict"], verdict["final"]) == ("real", "FAIL", False)


async def test_the_end_is_reported_and_a_death_as_well(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    await scene.start_broker()
    async with Person(scene.port, scene.controller) as person:
        async with connected_mqtt_operator(scene.setup, SECRETS, scene.controller):
            await person.until("status")
        states = [said["state"] for said in await person.until("status", 2)]
        assert states == ["flying", "ended"]
    async with Person(scene.port, scene.controller) as late:
        assert {said["state"] for said in await late.until("status")} == {"ended"}
    await scene.stop_broker()


@pytest.mark.parametrize("call", ["publish", "subscribe"])
async def test_it_ends_also_when_the_broker_answers_in_that_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    """Python 3.11's wait_for, which aiomqtt uses, drops a cancellation then."""
    scene = Scene(tmp_path)
    await scene.start_broker()
    waits: asyncio.Queue[asyncio.Future[None]] = asyncio.Queue()

    async def answered_later(*_: object, **__: object) -> None:
        answered = asyncio.get_running_loop().create_future()
        waits.put_nowait(answered)
        await asyncio.wait_for(answered, 60.0)

    monkeypatch.setattr(aiomqtt.Client, call, answered_later)
    client = MqttOperator(setup=scene.setup, secrets_=SECRETS, controller=scene.controller)
    running = asyncio.create_task(client.run())
    answered = await waits.get()
    running.cancel()
    if not answered.done():  # later Pythons cancel it at once
        answered.set_result(None)
    await asyncio.wait({running}, timeout=10.0)
    assert running.cancelled()
    client.close()
    await scene.stop_broker()


async def test_a_message_that_a_lost_broker_did_not_confirm_is_published_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = Scene(tmp_path)
    await scene.start_broker()
    published: asyncio.Queue[str] = asyncio.Queue()

    async def without_answer(_: aiomqtt.Client, topic: str, *__: object, **___: object) -> None:
        if topic.endswith("/verdict"):
            published.put_nowait(topic)
            await asyncio.sleep(60.0)

    monkeypatch.setattr(aiomqtt.Client, "publish", without_answer)
    async with connected_mqtt_operator(scene.setup, SECRETS, scene.controller):
        scene.controller.news(
            RunEventReport("large/wil/1", 9.0, "decisive", "FAIL", "", "a contact")
        )
        first = await published.get()
        await scene.stop_broker()
        await scene.start_broker()
        async with asyncio.timeout(60.0):
            assert await published.get() == first
    await scene.stop_broker()


async def test_a_broker_that_comes_back_finds_us_again(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    await scene.start_broker()
    async with connected_mqtt_operator(scene.setup, SECRETS, scene.controller):
        await scene.stop_broker()
        await asyncio.sleep(0.3)
        scene.controller.news(
            RunEventReport("large/wil/1", 9.0, "decisive", "FAIL", "", "meanwhile")
        )
        await scene.start_broker()
        async with Person(scene.port, scene.controller) as person:
            await person.until("status")
            assert (await person.command("abort"))["ok"]
        notes = [one["text"] for one in log(tmp_path) if not one["command"]]
        assert notes[0].startswith("the MQTT broker is disconnected: ")
        assert notes[1:] == ["reconnected to the MQTT broker"]
    await scene.stop_broker()


async def test_a_broker_that_goes_is_no_fault_of_ours(tmp_path: Path) -> None:
    faulty: list[str] = []
    loop = asyncio.get_running_loop()
    account = TaskAccount(
        fault=lambda _, where: faulty.append(where), expected=(OperatingError, OSError)
    )
    scene = Scene(tmp_path)
    with account.of(loop):
        await scene.start_broker()
        async with connected_mqtt_operator(scene.setup, SECRETS, scene.controller):
            await scene.stop_broker()
            async with asyncio.timeout(10.0):
                while not log_or_none(tmp_path):  # noqa: ASYNC110 - a file sets no event
                    await asyncio.sleep(0.01)
    assert faulty == []


async def test_a_client_that_fails_before_it_is_connected_keeps_nobody_waiting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fail(_: MqttOperator) -> None:
        raise RuntimeError("a fault of ours")

    monkeypatch.setattr(MqttOperator, "run", fail)
    scene = Scene(tmp_path)
    with pytest.raises(RuntimeError, match="a fault of ours"):
        async with (
            asyncio.timeout(5.0),
            connected_mqtt_operator(scene.setup, SECRETS, scene.controller),
        ):
            pass


@pytest.mark.parametrize("policy", ["continue", "hold", "abort"])
async def test_the_campaign_decides_the_reaction_to_a_lost_broker(
    tmp_path: Path, policy: str
) -> None:
    scene = Scene(tmp_path, on_loss=policy, lost_after_s=0.3)
    await scene.start_broker()
    async with connected_mqtt_operator(scene.setup, SECRETS, scene.controller):
        await scene.stop_broker()
        async with asyncio.timeout(10.0):
            while len(log_or_none(tmp_path)) < 1:  # noqa: ASYNC110 - a file sets no event
                await asyncio.sleep(0.01)
        await asyncio.sleep(0.6)
        assert scene.controller.held == (policy == "hold")
        assert (scene.controller.stopped == "command") == (policy == "abort")
    if policy != "continue":
        last = log(tmp_path)[-1]
        assert (last["command"], last["who"]) == (policy, "mqtt (the broker is away)")


def log_or_none(folder: Path) -> list[dict[str, Any]]:
    try:
        return log(folder)
    except OSError:
        return []


async def test_a_broker_that_is_not_there_is_an_error_at_the_start(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    with pytest.raises(OperatingError, match=r"cannot connect to the MQTT broker .*refused"):
        async with connected_mqtt_operator(scene.setup, SECRETS, scene.controller):
            pass


@pytest.mark.parametrize("state", ["flying", "ended", "lost"])
async def test_another_start_of_the_campaign_at_the_same_topics_is_reported(
    tmp_path: Path, state: str
) -> None:
    """One campaign flies in every hall, and each replaces the other's reports."""
    scene, said = Scene(tmp_path), list[str]()
    scene.controller = make_controller(tmp_path, scene.fleet, said=said)
    password = ACCESS.passwords["wil"]
    async with (
        scene,
        aiomqtt.Client("127.0.0.1", scene.port, username="wil", password=password) as other,
    ):
        for session in ("of hall b", "of hall c"):
            text = json.dumps({"state": state, "session": session})
            await other.publish("wil/gate/status", text, qos=1, retain=True)
        await scene.person.command("hold")  # and the statuses before it are read
    warned = [text for text in said if "another start of this campaign" in text]
    assert len(warned) == (state == "flying")
    assert all("campaign, of hall b: " in text for text in warned)


async def test_a_command_after_the_end_is_refused_and_changes_no_status(tmp_path: Path) -> None:
    """The broker kept `landing` of a campaign that had ended, and its exit code was 4."""
    scene = Scene(tmp_path)
    client = MqttOperator(setup=scene.setup, secrets_=SECRETS, controller=scene.controller)
    await client.finish()
    session = scene.controller.session
    said = {"session": session, "id": "late", "at": time.time(), "who": "anna"}
    payload = signed_command("wil/gate/operator/abort", said, TOKEN)
    client._execute_command("abort", payload, retained=False)
    client.status()  # as after a command on another way
    sent = [await client._outbox.take() for _ in range(3)]
    bodies = [json.loads(publication.payload) for publication in sent]
    assert [body.get("state") for body in bodies] == ["ended", None, "ended"]
    assert (bodies[1]["ok"], bodies[1]["text"]) == (False, "abort: the campaign has ended")
    assert scene.fleet.aborted == []
    client.close()


async def test_the_time_until_a_silent_broker_is_noticed_counts(tmp_path: Path) -> None:
    """A frozen broker was away for 7.8 s when `lost_after_s: 2` took effect; 5.8 s are needed."""
    scene = Scene(tmp_path, on_loss="abort", lost_after_s=5.05)
    client = MqttOperator(setup=scene.setup, secrets_=SECRETS, controller=scene.controller)
    client._connected = True
    client._disconnected("Operation timed out")
    async with asyncio.timeout(4.0):
        while not scene.fleet.aborted:  # noqa: ASYNC110 - a timer sets no event
            await asyncio.sleep(0.01)
    client.close()


async def test_over_a_slow_link_the_last_status_is_sent_before_what_was_queued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The broker kept `flying` of a campaign that had ended long ago."""
    monkeypatch.setattr(mqtt_operator, "_FLUSH_S", 0.05)
    scene = Scene(tmp_path)
    client = MqttOperator(setup=scene.setup, secrets_=SECRETS, controller=scene.controller)
    client._connected = True
    for _ in range(3):
        client.news(RunEventReport("large/sim/1", 1.0, "stage", "takeoff", "", "", "", ""))
    await client.finish()
    assert json.loads((await client._outbox.take()).payload)["state"] == "ended"
    assert client._outbox.empty
    client.close()


async def test_a_socket_is_not_closed_before_what_was_sent_is_acknowledged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The broker reset such a connection, and published `lost` after `ended`."""
    monkeypatch.setattr(mqtt_operator, "_FLUSH_S", 0.2)
    scene = Scene(tmp_path)
    client = MqttOperator(setup=scene.setup, secrets_=SECRETS, controller=scene.controller)
    client._connected = client._is_publishing = True
    finishing = asyncio.create_task(client.finish())
    await client._outbox.take()
    await asyncio.sleep(0.12)
    assert not finishing.done()
    await finishing
    client.close()


async def test_a_broker_that_refuses_the_subscription_is_an_error_at_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No command would ever come: the operators' abort neither."""

    def permits(_: BrokerAccess, _user: str | None, action: str, _topic: str) -> bool:
        return action != "subscribe"

    monkeypatch.setattr(BrokerAccess, "permits", permits)
    scene = Scene(tmp_path)
    await scene.start_broker()
    with pytest.raises(OperatingError, match=r"this user subscribe to wil/gate/operator/\+"):
        async with connected_mqtt_operator(scene.setup, SECRETS, scene.controller):
            pass
    await scene.stop_broker()


def test_the_program_ends_with_3_before_anything_flies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    broker = f"mqtt://127.0.0.1:{free_port()}"
    arguments = ["run", "campaigns/gate.yaml", "--out", str(out), "--broker", broker]
    assert main(arguments) == 3
    assert f"cannot connect to the MQTT broker {broker}" in capsys.readouterr().err
    assert not list(out.glob("**/result.json"))


async def test_a_taken_port_is_an_error_of_the_embedded_broker(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        address = BrokerAddress("127.0.0.1", taken.getsockname()[1], embedded=True)
        with pytest.raises(OperatingError, match="choose another"):
            async with embedded_broker(address, ACCESS):
                pass


@pytest.fixture
def runtime(short_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))


@pytest.mark.usefixtures("runtime")
async def test_a_token_is_made_where_none_is_named(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    async with open_operator_channels(scene.controller, {"mqtt": scene.setup}):
        path = tmp_path / "operator.token"
        token = path.read_text().strip()
        known = json.loads((tmp_path / "operator.access.json").read_text())
        for name in ("operator.token", "operator.access.json"):
            assert (tmp_path / name).stat().st_mode & 0o777 == 0o600
        assert set(known["passwords"]) == {"operator", "watcher"}
        access = BrokerAccess(base=known["topics"], passwords=known["passwords"])
        async with Person(scene.port, scene.controller, access) as person:
            assert (await person.command("abort"))["text"] == "wrong signature"
            assert (await person.command("abort", token=token))["ok"]


@pytest.mark.usefixtures("runtime")
async def test_a_command_is_signed_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(tmp_path)
    async with open_operator_channels(scene.controller, {"mqtt": scene.setup}):
        known = json.loads((tmp_path / "operator.access.json").read_text())
        access = BrokerAccess(base=known["topics"], passwords=known["passwords"])
        async with Person(scene.port, scene.controller, access) as person:
            assert main(["sign", "hold", str(tmp_path), "--who", "ben"]) == 0
            await person.say("hold", capsys.readouterr().out.strip().encode())
            (answer,) = await person.until("operator/ack")
    assert (answer["ok"], answer["who"]) == (True, "mqtt:ben")


async def test_the_token_is_never_on_the_wire(scene: Scene) -> None:
    """Whatever the broker passes on, nothing of it lets anybody command."""
    taken: list[bytes] = []
    async with aiomqtt.Client(
        "127.0.0.1", scene.port, username="watcher", password=ACCESS.passwords["watcher"]
    ) as spy:
        await spy.subscribe("wil/gate/#")

        async def listen() -> None:
            async for message in spy.messages:
                assert isinstance(message.payload, bytes)
                taken.append(bytes(message.payload))

        listening = asyncio.create_task(listen())
        assert (await scene.person.command("hold"))["ok"]
        await asyncio.sleep(0.2)
        listening.cancel()
    heard = [payload for payload in taken if b'"who": "anna"' in payload]
    assert heard
    assert not any(TOKEN.encode() in payload for payload in taken)
    before = len(await scene.person.until("operator/ack"))
    await scene.person.say("hold", heard[0])
    await scene.person.say("abort", heard[0])
    answers = (await scene.person.until("operator/ack", before + 2))[before:]
    assert sorted(said["text"] for said in answers) == [
        "this id was used already",
        "wrong signature",
    ]
    assert scene.fleet.aborted == []


@pytest.mark.parametrize("who", [None, ("operator", "guess"), ("wil", ""), ("eve", "eve")])
async def test_nobody_without_a_password_reaches_the_embedded_broker(
    scene: Scene, who: tuple[str, str] | None
) -> None:
    user, password = who or (None, None)
    with pytest.raises(aiomqtt.MqttError):
        async with aiomqtt.Client("127.0.0.1", scene.port, username=user, password=password):
            pass


async def test_users_of_the_embedded_broker_keep_to_their_topics(scene: Scene) -> None:
    (status,) = await scene.person.until("status")

    def client(user: str, **more: Any) -> aiomqtt.Client:
        password = ACCESS.passwords[user]
        return aiomqtt.Client("127.0.0.1", scene.port, username=user, password=password, **more)

    ended = json.dumps({"state": "ended"}).encode()
    for user in ("operator", "watcher"):
        async with client(user) as one:
            await one.publish("wil/gate/status", ended, qos=1, retain=True)
            await one.publish("wil/gate/operator/ack", ended, qos=1)
        will = aiomqtt.Will("wil/gate/status", ended, qos=1, retain=True)
        with pytest.raises(aiomqtt.MqttError):
            async with client(user, will=will):
                pass
    body = {"session": scene.controller.session, "id": "w", "at": time.time()}
    async with client("watcher") as one:
        payload = signed_command("wil/gate/operator/abort", body, TOKEN)
        await one.publish("wil/gate/operator/abort", payload, qos=1)
    assert (await scene.person.command("hold"))["ok"]
    assert scene.fleet.aborted == []
    states = [said["state"] for said in scene.person.of("status")]
    assert states == ["flying", "held"]
    # Who knows the key sees which statuses are the program's.
    key = status_key(TOKEN)
    assert set(status) >= {"state", "at", "signature"}
    assert verified_message("wil/gate/status", json.dumps(status).encode(), key)


@pytest.mark.usefixtures("runtime")
async def test_a_secret_that_is_not_set_is_reported(tmp_path: Path) -> None:
    scene = Scene(tmp_path, token_env="WIL_NOT_SET")  # noqa: S106
    with pytest.raises(OperatingError, match="the variable WIL_NOT_SET is not set"):
        async with open_operator_channels(scene.controller, {"mqtt": scene.setup}):
            pass


async def test_a_broker_that_ends_the_connection_for_the_status_is_asked_for_it_once() -> None:
    asked: list[str] = []

    async def refuse(topic: str, *, qos: int) -> None:
        asked.append(topic)
        raise aiomqtt.MqttError

    operator: Any = SimpleNamespace(_base="wil/gate", _has_asked_status=False)
    client: Any = SimpleNamespace(subscribe=refuse)
    for _ in range(2):
        with suppress(aiomqtt.MqttError):
            await mqtt_operator.MqttOperator._watch_status(operator, client)
    assert asked == ["wil/gate/status"]


async def test_a_connection_that_says_nothing_or_nonsense_is_closed_by_the_embedded_broker() -> (
    None
):
    address = BrokerAddress("127.0.0.1", free_port(), embedded=True)
    async with embedded_broker(address, ACCESS):
        for said in (b"", b"\x10", b"nonsense") * 8:
            reader, writer = await asyncio.open_connection(address.host, address.port)
            writer.write(said)
            writer.write_eof()
            async with asyncio.timeout(10):
                assert await reader.read() == b""
            writer.close()
