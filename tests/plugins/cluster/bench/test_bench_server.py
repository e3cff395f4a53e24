"""What ends the server of a bench, when all is down: a damaged message, in plain words; Ctrl-C."""

import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from multiprocessing import Pipe
from multiprocessing.connection import Client, Connection
from pathlib import Path
from typing import Any

import msgspec
import pytest

from tests.plugins.cluster.bench.test_bench_engine import write_bench
from tests.plugins.cluster.fake_ray import FakeReference
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.orchestrator.cli import main
from wil_campaign.plugins.cluster import ray_agents
from wil_campaign.plugins.cluster.bench import bench_command as commands
from wil_campaign.plugins.cluster.bench import bench_server
from wil_campaign.plugins.cluster.bench.bench_engine import hire_bench
from wil_campaign.plugins.cluster.bench.bench_server import BenchServer
from wil_campaign.plugins.cluster.node_messages import (
    CampaignAnswer,
    CommandSent,
    ConsentAnswer,
    ConsentAsked,
    RunSending,
    ToNode,
    decode_to_node,
    encode_to_campaign,
    encode_to_node,
)
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

WHOLE = encode_to_node(ConsentAsked("hover", 2, arm=True, place="ann on desk"))
DAMAGED = {
    "empty": b"",
    "garbage": b"\xff\x00garbage",
    "cut": WHOLE[:-9],
    "unknown message": msgspec.msgpack.encode(["NoSuchMessage", "hover"]),
    "no message": msgspec.msgpack.encode(3),
    "no order": msgspec.msgpack.encode(["RunOrdered", "no order"]),
    "of the other direction": encode_to_campaign(CampaignAnswer()),
    "a pickle": b"cos\nsystem\n(S'false'\ntR.",
}


class IdleNode:
    """The process that flies, which says nothing until it is closed."""

    def __init__(self) -> None:
        self.closed = threading.Event()

    def receive(self, _: float) -> list[bytes]:
        self.closed.wait()
        raise EOFError

    def close(self) -> None:
        self.closed.set()


@pytest.fixture
def nodes(monkeypatch: pytest.MonkeyPatch) -> list[IdleNode]:
    begun: list[IdleNode] = []

    def begin() -> IdleNode:
        begun.append(IdleNode())
        return begun[-1]

    monkeypatch.setattr(bench_server, "NodeAgent", begin)
    return begun


@pytest.mark.parametrize("kind", DAMAGED)
def test_a_damaged_message_ends_bench_serve_in_plain_words(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    nodes: list[IdleNode],
    kind: str,
) -> None:
    class Joined:
        def wait(self) -> None:
            threading.Event().wait()

    @contextmanager
    def join(_: str, __: object, socket: Path) -> Iterator[Joined]:
        with Client(str(socket), family="AF_UNIX") as campaign:
            campaign.send_bytes(DAMAGED[kind])
            yield Joined()

    monkeypatch.setattr(commands, "bench_node", join)
    monkeypatch.setattr(commands, "has_terminal", lambda: True)
    write_bench(tmp_path)
    code = main(
        ["bench", "serve", str(tmp_path / "hall-a.yaml"), "--engine", "ray://127.0.0.1:6379"]
    )
    said = capsys.readouterr().err
    assert code == 3, said
    assert "bench hall-a: a message of the cluster is damaged" in said
    assert "start `bench serve` again" in said
    assert "Traceback" not in said
    assert [node.closed.is_set() for node in nodes] == [True]


class Saying:
    """A Ray with one actor, whose first message is damaged."""

    class exceptions:  # noqa: N801 - as Ray has it
        class GetTimeoutError(Exception): ...

        class RayError(Exception): ...

    def __init__(self, content: bytes) -> None:
        self.content = content
        self.killed = 0

    def remote(self, **_: object) -> Any:
        said: Future[list[bytes]] = Future()
        said.set_result([self.content])

        class Actor:
            class receive:  # noqa: N801 - an attribute of the actor
                @staticmethod
                def remote(_: float) -> FakeReference:
                    return FakeReference(said)

        return lambda _: type("Class", (), {"remote": staticmethod(Actor)})

    def get(self, references: list[object], timeout: float) -> list[list[bytes]]:
        return [[self.content] for _ in references]

    def kill(self, _: object, *, no_restart: bool) -> None:
        self.killed += 1


@pytest.mark.parametrize("kind", DAMAGED)
def test_a_node_that_says_nothing_readable_is_dismissed(kind: str) -> None:
    ray: Any = Saying(DAMAGED[kind])
    for hire in (
        lambda: ray_agents.hire_agents(ray, 2, cores=1),
        lambda: hire_bench(ray, "hall-a", 1.0),
    ):
        with pytest.raises(EngineError, match=r"the facts of .* cannot be read") as raised:
            hire()
        assert raised.value.code == 3
    assert ray.killed == 3


class TalkingNode:
    """A process that flies, which has sent more than the campaign's connection takes, and ended."""

    def __init__(self) -> None:
        self.sent: list[ToNode] = []
        self._news = [encode_to_campaign(RunSending(1))] * 10_000

    def send(self, content: bytes) -> None:
        self.sent.append(decode_to_node(content))

    def receive(self, _: float) -> list[bytes]:
        if not self._news:
            raise EOFError
        news, self._news = self._news, []
        return news

    def close(self) -> None:
        pass


class Interrupted:
    """A connection to a campaign; Ctrl-C at the bench while its messages are awaited."""

    def __init__(self, connection: Connection) -> None:
        self.send_bytes, self.fileno = connection.send_bytes, connection.fileno

    def recv_bytes(self) -> bytes:
        raise KeyboardInterrupt


def test_ctrl_c_lands_and_ends_the_bench_of_a_campaign_that_stands_still(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench_server, "_RELAYED_S", 0.05)
    node, shown = TalkingNode(), list[str]()
    monkeypatch.setattr(bench_server, "NodeAgent", lambda: node)
    ours, theirs = Pipe()
    late = threading.Timer(10.0, theirs.close)  # so that a server that waits for it ends as well
    late.start()
    server = BenchServer(write_bench(tmp_path), consent=lambda _: ConsentAnswer(), say=shown.append)
    connection: Any = Interrupted(ours)
    with pytest.raises(KeyboardInterrupt):
        server.serve_campaign(connection)
    assert late.is_alive()
    late.cancel()
    abort = OperatorCommand("abort", "Ctrl-C at the terminal of bench hall-a")
    assert node.sent == [CommandSent(abort)]
    assert shown == ["bench hall-a is free"]


class SlowlyLanding(TalkingNode):
    """A process whose run still lands at the second and third Ctrl-C."""

    def __init__(self) -> None:
        super().__init__()
        self.waits = 0
        self.ended = threading.Event()

    def receive(self, _: float) -> list[bytes]:
        self.ended.wait()
        raise EOFError

    def close(self) -> None:
        self.waits += 1
        if self.waits < 3:
            raise KeyboardInterrupt
        self.ended.set()


def test_a_further_ctrl_c_does_not_end_the_bench_before_the_landing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    node, shown = SlowlyLanding(), list[str]()
    monkeypatch.setattr(bench_server, "NodeAgent", lambda: node)
    ours, theirs = Pipe()
    server = BenchServer(write_bench(tmp_path), consent=lambda _: ConsentAnswer(), say=shown.append)
    connection: Any = Interrupted(ours)
    try:
        with pytest.raises(KeyboardInterrupt):
            server.serve_campaign(connection)
        assert node.ended.is_set()
    finally:
        node.ended.set()
        theirs.close()
    assert [text.partition(";")[0] for text in shown] == [
        "still landing", "still landing", "bench hall-a is free"
    ]  # fmt: skip
