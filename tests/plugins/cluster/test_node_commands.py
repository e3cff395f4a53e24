"""Commands on a node: to its run, and an abort past the run to its guard; news of the run."""

import asyncio
import os
import threading
from collections.abc import Iterator
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from wil_campaign.orchestrator.campaign.workers.run_workers import OrderDone, WorkerLost
from wil_campaign.orchestrator.operator import local_commands
from wil_campaign.orchestrator.operator.campaign_records import OperatorPlace, OperatorPlaces
from wil_campaign.orchestrator.operator.run_messages import RunEventReport
from wil_campaign.plugins.cluster import node_process
from wil_campaign.plugins.cluster.node_messages import (
    CommandSent,
    NodeRunHappening,
    RunEnded,
    ToCampaign,
    ToNode,
    decode_to_campaign,
    encode_to_node,
)
from wil_campaign.plugins.cluster.node_process import NodeRuns, _is_deserted
from wil_campaign.plugins.cluster.ray_agents import HiredAgent
from wil_campaign.plugins.cluster.ray_worker import RayWorker
from wil_campaign.plugins.cluster.returned_results import FetchedResults
from wil_campaign.safety.guard.core.operator_command import OperatorCommand


class SilentWorker:
    """A worker whose run hangs: it takes commands and does nothing about them."""

    def __init__(self) -> None:
        self.commands: list[OperatorCommand] = []
        self.is_killed = False

    def kill(self) -> None:
        self.is_killed = True

    def send(self, command: OperatorCommand) -> None:
        self.commands.append(command)


async def test_an_abort_goes_past_a_run_that_hangs_to_its_guard_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, other = tmp_path / "hover/1/default/sim/1", tmp_path / "hover/1/default/sim/2"
    guards = tuple(OperatorPlace("guard", folder, folder / "socket") for folder in (run, other))
    told: list[tuple[Path, str, str]] = []
    monkeypatch.setattr(local_commands, "operator_places", lambda: OperatorPlaces((), guards))
    monkeypatch.setattr(
        local_commands,
        "tell_operator_socket",
        lambda path, command, *, who: told.append((path, command, who)),
    )
    commands, sender = Pipe()
    reports, _ = Pipe()
    worker: Any = SilentWorker()
    passing = asyncio.create_task(NodeRuns(commands, reports, tmp_path)._pass_commands(worker, run))
    sender.send_bytes(encode_to_node(CommandSent(OperatorCommand("hold", "anna"))))
    sender.send_bytes(encode_to_node(CommandSent(OperatorCommand("abort", "ben"))))
    async with asyncio.timeout(10):
        while not told:  # noqa: ASYNC110 - sets no event
            await asyncio.sleep(0.01)
    assert told == [(run / "socket", "abort", "ben")]
    assert not worker.is_killed
    monkeypatch.setattr(node_process, "_LANDED_S", 0.05)
    sender.close()  # the cluster is gone
    await passing
    assert worker.is_killed  # so that nothing is left on the node; its guard has the vehicles
    assert [(one.kind, one.who) for one in worker.commands] == [
        ("hold", "anna"),
        ("abort", "ben"),
        ("abort", "the node: its cluster is gone"),
    ]


class Reader:
    """The other end of a node's standard output, which reads nothing by itself.

    It closes after some seconds, so that whoever blocks ends: `blocked`.
    """

    def __init__(self) -> None:
        output, their_input = os.pipe()
        self.reports = Connection(their_input, readable=False)
        self._end = Connection(output, writable=False)
        self.blocked = False
        self._timer = threading.Timer(10.0, self._unblock)
        self._timer.start()

    def _unblock(self) -> None:
        self.blocked = True
        self._end.close()

    def read(self) -> ToCampaign:
        return decode_to_campaign(self._end.recv_bytes())

    def close(self) -> None:
        self._timer.cancel()
        self._end.close()
        self.reports.close()


@pytest.fixture
def reader() -> Iterator[Reader]:
    one = Reader()
    yield one
    one.close()


class TalkingWorker(SilentWorker):
    """A worker whose run has much to tell, and then flies on."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.news = [RunEventReport("hover/sim/1", 1.0, "guard", "event", "real", text)] * 1000
        self.aborted = asyncio.Event()

    async def begin(self, order: object) -> None:
        pass

    async def receive(self) -> object:
        if not self.news:
            await asyncio.Event().wait()
        return self.news.pop()

    def send(self, command: OperatorCommand) -> None:
        super().send(command)
        self.aborted.set()


@pytest.mark.parametrize("text", ["short", "longer than a pipe takes at once" * 1000])
async def test_a_campaign_that_reads_nothing_keeps_no_abort_from_a_run(
    tmp_path: Path, reader: Reader, text: str
) -> None:
    commands, sender = Pipe()
    runs, worker, order = (
        NodeRuns(commands, reader.reports, tmp_path),
        TalkingWorker(text),
        object(),
    )
    run: Any = worker
    ordered: Any = order
    flying = [
        asyncio.create_task(runs._follow(run, ordered)),
        asyncio.create_task(runs._pass_commands(run, tmp_path)),
    ]
    await asyncio.sleep(0)  # they begin, and the pipe fills
    sender.send_bytes(encode_to_node(CommandSent(OperatorCommand("abort", "ben"))))
    await worker.aborted.wait()
    for one in flying:
        one.cancel()
    await asyncio.wait(flying)
    assert not reader.blocked
    assert [(command.kind, command.who) for command in worker.commands] == [("abort", "ben")]


async def test_an_end_waits_for_its_reader_behind_the_news_before(
    tmp_path: Path, reader: Reader
) -> None:
    commands, _ = Pipe()
    runs, news = NodeRuns(commands, reader.reports, tmp_path), TalkingWorker("short").news
    for one in news:
        await runs._report(NodeRunHappening(one))
    ended = RunEnded.of(WorkerLost("x" * 100_000))
    sending = asyncio.create_task(runs._send(ended))
    while not runs._is_sending:  # noqa: ASYNC110 - sets no event
        await asyncio.sleep(0)
    await runs._report(NodeRunHappening(news[0]))  # not into the middle of the end
    read = [reader.read()]
    while not isinstance(read[-1], RunEnded):
        read.append(reader.read())
    await sending
    assert read == [NodeRunHappening(news[0])] * (len(read) - 1) + [ended]
    assert 100 < len(read) < len(news)
    assert not reader.blocked


async def test_an_end_without_a_waiter_is_given_up(
    tmp_path: Path, reader: Reader, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(node_process, "_REPORT_S", 0.01)
    commands, sender = Pipe()
    runs, ended = (
        NodeRuns(commands, reader.reports, tmp_path),
        RunEnded.of(WorkerLost("x" * 99_999)),
    )
    sending = asyncio.create_task(runs._send(ended))
    done, _ = await asyncio.wait([sending], timeout=0.1)
    assert not done
    sender.close()
    await sending
    await runs._send(ended)  # nor is another begun in the middle of it
    assert not reader.blocked


def test_a_node_notices_that_its_cluster_is_gone_also_with_words_unread() -> None:
    reading, writing = os.pipe()
    commands, sender = Connection(reading, writable=False), Connection(writing, readable=False)
    assert not _is_deserted(commands)
    sender.send("an order")
    assert not _is_deserted(commands)
    sender.close()
    assert _is_deserted(commands)
    here, there = Pipe()
    there.close()
    assert _is_deserted(here)


async def test_a_run_that_has_arrived_counts_though_its_node_has_ended_since() -> None:
    """As a bench ends after Ctrl-C, before it is told that the run's files are here."""
    written: list[str] = []
    killed: list[bool] = []

    class Agent:
        node = "bench"

        async def receive(self) -> list[ToCampaign]:
            return [RunEnded.of(WorkerLost("x"))]

        async def send(self, message: ToNode) -> None:
            raise EOFError(type(message).__name__)

        def kill(self) -> None:
            killed.append(True)

    ledger: Any = SimpleNamespace(write=lambda event, *_: written.append(event))
    worker = RayWorker(
        agent=cast("HiredAgent", Agent()),
        ledger=ledger,
        results=cast("FetchedResults", None),
        give_back=lambda _: None,
    )
    assert isinstance(await worker.receive(), OrderDone)
    assert (written, killed) == (["lost"], [True])
