"""How fast the guard acts, and what it costs: figures beside their marks.

`python -m bench.guard [--trials 100] [--idle] [--sockets]`; p99 of the trials. Unless --idle, two
more processes mix images as fast as they can meanwhile, as many as this needs cores for.
--sockets: of the aborts by socket alone, with and without a storm of connections. On a machine with
other work to do, `chrt -f 20` before it keeps that work out of the figures.
"""

import argparse
import asyncio
import contextlib
import os
import secrets
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

import aiomqtt

from bench.connection_storm import storm
from tests.faults.environment import broker_process
from tests.orchestrator.operator.controllers import FakeFleet, make_controller
from tests.orchestrator.wall_runs import ROOT, Program, lines
from tests.ports import free_port
from tests.safety.conftest import FakeVehicle
from tests.safety.guard.remote_rigs import (
    PATIENT,
    SYSTEMS,
    guard_config,
    start_orchestrator,
    until,
    words,
)
from wil_campaign.foundation.tasks import start_task, stop_tasks
from wil_campaign.orchestrator.operator.campaign_records import OperatorPlace, operator_places
from wil_campaign.plugins.mqtt.broker_address import BrokerAddress
from wil_campaign.plugins.mqtt.message_signing import signed_command
from wil_campaign.plugins.mqtt.mqtt_operator import MqttSecrets, connected_mqtt_operator
from wil_campaign.plugins.mqtt.mqtt_setup import MqttSetup
from wil_campaign.safety.guard.core.commands import BringDown
from wil_campaign.safety.guard.core.events import GuardSettings
from wil_campaign.safety.guard.process.remote_guard import RemoteGuard
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.links.link_strings import LinkAddress
from wil_campaign.vehicles.links.udp import UdpLink
from wil_campaign.vehicles.mavlink.framing import FrameSplitter
from wil_campaign.worlds.frames import Pose

_STEP_S = 0.02
_GUARD_COMPONENT = GuardSettings().component_id
_COMMAND_IDS = frozenset({11, 76, 84})
"""SET_MODE, COMMAND_LONG, SET_POSITION_TARGET_LOCAL_NED."""
_TICKS_S = os.sysconf("SC_CLK_TCK")


class Wire:
    """A vehicle's end of its link in this process: flies, and notes the guard's first command."""

    def __init__(self, name: str, system: int, port: int) -> None:
        self.vehicle = FakeVehicle(name, system=system, up_m=1.0)
        self.link = UdpLink(address=LinkAddress(kind="udpout", host="127.0.0.1", port=port))
        self.link.receive(self._take)
        self.commanded = asyncio.Event()
        self.at_s = 0.0
        self._frames = FrameSplitter()

    def _take(self, data: bytes, t_s: float) -> None:
        now_s = time.monotonic()
        for frame in self._frames.feed(data):
            steers = frame.component == _GUARD_COMPONENT and frame.message_id in _COMMAND_IDS
            if steers and not self.commanded.is_set():
                self.at_s = now_s
                self.commanded.set()
        self.vehicle.receive((data,), t_s)

    async def fly(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            self.vehicle.step(loop.time())
            self.link.write(self.vehicle.frames(loop.time()))
            await asyncio.sleep(_STEP_S)


@asynccontextmanager
async def guarded(folder: Path) -> AsyncIterator[tuple[RemoteGuard, Wire]]:
    """A guard's process over two vehicles in the air; gives the one that is timed."""
    guard = RemoteGuard(guard_config=guard_config(folder, settings=PATIENT))
    is_received = asyncio.Event()
    async with contextlib.AsyncExitStack() as stack:
        for name in SYSTEMS:
            link = guard.link(name)
            link.receive(lambda *_: is_received.set())
            await stack.enter_async_context(link)
        await stack.enter_async_context(guard)
        wires = [Wire(name, system, guard.port(name)) for name, system in SYSTEMS.items()]
        for wire in wires:
            await stack.enter_async_context(wire.link)
            stack.push_async_callback(stop_tasks, start_task(wire.fly(), name="wire"))
        await is_received.wait()
        await asyncio.sleep(0.3)
        yield guard, wires[0]
        guard.send(BringDown("measured"))
        await guard.all_down(15.0)


async def act_s(folder: Path, act: Callable[[RemoteGuard], Awaitable[float]]) -> float:
    """Return the time from an act (which returns when it was begun) to the wire."""
    async with guarded(folder) as (guard, wire):
        began_s = await act(guard)
        async with asyncio.timeout(5.0):
            await wire.commanded.wait()
        return wire.at_s - began_s


async def breach(guard: RemoteGuard) -> float:
    now_s = asyncio.get_running_loop().time()
    began_s = time.monotonic()
    guard.position(PoseSample(now_s, "real", Pose((7.0, 0.0, -1.0)), (0.0, 0.0, 0.0)))
    return began_s


async def by_socket(folder: Path) -> float:
    (place,) = operator_places().beneath(folder).guards
    began_s = time.monotonic()  # a place for the connection is part of it
    reader, writer = await asyncio.open_unix_connection(place.socket)
    writer.write(b'{"command": "abort", "who": "bench"}\n')
    await reader.readline()
    writer.close()
    return began_s


async def in_storm(folder: Path) -> float:
    """Abort while a thousand connections a second come to the same socket."""
    (place,) = operator_places().beneath(folder).guards
    async with storm(place.socket) as rate_hz:
        if rate_hz < 900.0:
            print(f"the storm came to {rate_hz:.0f} connections a second only", flush=True)
        return await by_socket(folder)


async def by_mqtt(folder: Path, port: int) -> float:
    """Return the time from the publication of an abort to the wire."""
    token = secrets.token_hex(8)
    setup = MqttSetup(broker=BrokerAddress("127.0.0.1", port))
    fleet = FakeFleet()
    controller = make_controller(folder, fleet)

    def guards() -> tuple[OperatorPlace, ...]:
        return operator_places().beneath(folder).guards

    controller.guards = guards
    async with (
        connected_mqtt_operator(setup, MqttSecrets(token=token), controller),
        aiomqtt.Client("127.0.0.1", port) as client,
    ):

        async def act(_: RemoteGuard) -> float:
            topic = "wil/gate/operator/abort"
            command = {"session": controller.session, "id": "1", "at": time.time()}
            began_s = time.monotonic()
            await client.publish(topic, signed_command(topic, command, token), qos=1)
            return began_s

        return await act_s(folder, act)


async def killed(folder: Path) -> float:
    """Return the time from kill -9 of an orchestrator to the guard's first command."""
    program, _ = await start_orchestrator(folder)
    killed_s = time.monotonic()
    program.kill()
    await program.wait()
    await until(lambda: "LAND" in [word for _, word in words(folder, "real")])
    acts = [t_s for t_s, word in words(folder, "real") if word in {"HOLD", "ZERO"}]
    return min(t_s for t_s in acts if t_s > killed_s) - killed_s


_BARE = """
import os, socket, sys
near, far = (socket.socket(fileno=int(one)) for one in sys.argv[1:])
os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1)) if os.geteuid() == 0 else None
while data := near.recv(2048):
    far.send(data)
"""
"""A program that passes datagrams on and does nothing else: no hop of Python's can be shorter."""


async def bare_hop_ms(count: int) -> float:
    """Return what a process that only passes datagrams on adds to their way, in the median."""
    near, ours = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    near.bind(("127.0.0.1", 0))
    ours.connect(near.getsockname())
    here, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    straight_out, straight_in = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    taken: dict[bool, list[float]] = {True: [], False: []}
    sent_s = [0.0]
    loop = asyncio.get_running_loop()
    with contextlib.ExitStack() as stack:
        for one in (near, ours, here, far, straight_out, straight_in):
            stack.enter_context(one)
        for end, is_through in ((here, True), (straight_in, False)):
            end.setblocking(False)

            def read(end: socket.socket = end, is_through: bool = is_through) -> None:
                end.recv(2048)
                taken[is_through].append(time.monotonic() - sent_s[0])

            loop.add_reader(end, read)
            stack.callback(loop.remove_reader, end)
        words_ = (sys.executable, "-c", _BARE, str(near.fileno()), str(far.fileno()))
        program = subprocess.Popen(words_, pass_fds=(near.fileno(), far.fileno()))  # noqa: ASYNC220, S603
        stack.callback(program.wait)
        stack.callback(program.kill)
        await asyncio.sleep(0.5)
        for number in range(2 * count):
            await asyncio.sleep(0.004)
            sent_s[0] = time.monotonic()
            (ours if number % 2 else straight_out).send(bytes(40))
            await asyncio.sleep(0.004)
    return 1e3 * (statistics.median(taken[True]) - statistics.median(taken[False]))


async def hop_ms(folder: Path, count: int) -> float:
    """Return what the guard adds to a frame's way, in the median, over plain UDP."""
    through: list[float] = []
    straight: list[float] = []
    sent_s = [0.0]
    async with guarded(folder) as (guard, wire):
        here = UdpLink(address=LinkAddress(kind="udpin", host="127.0.0.1", port=0))
        here.receive(lambda *_: straight.append(time.monotonic() - sent_s[0]))
        async with here:
            out = UdpLink(
                address=LinkAddress(kind="udpout", host="127.0.0.1", port=here.local_port)
            )
            async with out:
                frame = wire.vehicle.frames(asyncio.get_running_loop().time())
                guard.link("real").receive(lambda *_: through.append(time.monotonic() - sent_s[0]))
                for number in range(2 * count):
                    await asyncio.sleep(0.004)
                    sent_s[0] = time.monotonic()
                    (wire.link if number % 2 else out).write(frame)
                    await asyncio.sleep(0.004)
    return 1e3 * (statistics.median(through) - statistics.median(straight))


async def cost(folder: Path) -> tuple[float, float]:
    """Return the guard's largest RSS in MB and its share of a core, in a whole flight."""
    async with Program(folder, "--mode", "wil", "--json") as program:
        await program.stage("ready")
        (pid,) = [
            line["pid"]
            for line in lines(program.run_folder() / "guard.jsonl")
            if line["event"] == "opened"
        ]
        rss_mb, began_s, began_cpu_s = 0.0, time.monotonic(), _cpu_s(pid)
        share = 0.0
        while program.process.returncode is None:
            with contextlib.suppress(OSError, ValueError, IndexError):
                rss_mb = max(rss_mb, _rss_mb(pid))
                share = (_cpu_s(pid) - began_cpu_s) / (time.monotonic() - began_s)
            await asyncio.sleep(0.5)
            if "landed" in [
                line.get("stage") for line in lines(program.run_folder() / "log.jsonl")
            ]:
                break
        await program.end()
    return rss_mb, share


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_S


def _rss_mb(pid: int) -> float:
    text = Path(f"/proc/{pid}/status").read_text("utf-8")
    return int(text.partition("VmRSS:")[2].split()[0]) / 1024.0


@contextmanager
def load(*, idle: bool) -> Iterator[None]:
    """Have both cores mix images meanwhile."""
    if idle:
        yield
        return
    with tempfile.TemporaryDirectory() as out:
        words_ = (
            *(sys.executable, "-m", "wil_campaign", "run", "campaigns/gate.yaml"),
            *("--out", out, "--repetitions", "1000", "--jobs", "2", "--mode", "wil", "--json"),
            *("--set", "accept=null"),
        )
        environment = {**os.environ, "XDG_RUNTIME_DIR": out}
        with subprocess.Popen(  # noqa: S603 - our own program
            words_, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as process:
            try:
                time.sleep(10.0)
                yield
            finally:
                process.terminate()


def p99_ms(values: list[float]) -> float:
    ordered = sorted(values)
    return 1e3 * ordered[min(len(ordered) - 1, round(0.99 * len(ordered)))]


def spread_ms(values: list[float]) -> str:
    """Return median, longest and number of values, and the machine's load."""
    median_ms, longest_ms = 1e3 * statistics.median(values), 1e3 * max(values)
    head = f", median {median_ms:.2g} ms, longest {longest_ms:.3g} ms, n {len(values)}"
    return f"{head}, load {os.getloadavg()[0]:.1f}"


def tell(what: str, value: float, mark: float, unit: str, more: str = "") -> None:
    verdict = "ok" if value < mark else "MISSED"
    print(f"{what}: {value:.3g} {unit} (mark: below {mark:g}) {verdict}{more}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--idle", action="store_true")
    parser.add_argument("--sockets", action="store_true")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="wil-") as base:
        os.environ["XDG_RUNTIME_DIR"] = base
        os.environ["PYTHONPATH"] = str(ROOT)
        count = [0]

        def folder() -> Path:
            count[0] += 1
            made = Path(base) / str(count[0])
            made.mkdir()
            return made

        def trials(trial: Callable[[], Awaitable[float]], number: int) -> list[float]:
            async def one() -> float:
                return await trial()

            return [asyncio.run(one()) for _ in range(number)]

        async def socket_trial() -> float:
            mine = folder()
            return await act_s(mine, lambda _: by_socket(mine))

        async def storm_trial() -> float:
            mine = folder()
            return await act_s(mine, lambda _: in_storm(mine))

        with load(idle=asked.idle):
            for what, trial, mark_ms in (
                ("breach to wire, p99", lambda: act_s(folder(), breach), 20.0),
                ("abort by socket to wire, p99", socket_trial, 10.0),
                ("the same under 1,000 connections a second, p99", storm_trial, 10.0),
            )[1 if asked.sockets else 0 :]:
                found = trials(trial, asked.trials)
                tell(what, p99_ms(found), mark_ms, "ms", spread_ms(found))
            if asked.sockets:
                return
            port = free_port()
            with broker_process(port):
                found = trials(lambda: by_mqtt(folder(), port), asked.trials)
            tell("abort by MQTT to wire, p99", p99_ms(found), 30.0, "ms", spread_ms(found))
            found = trials(lambda: killed(folder()), max(5, asked.trials // 5))
            tell("orchestrator kill -9 to the guard's act, longest", max(found), 0.5, "s")
            hops = trials(lambda: hop_ms(folder(), 500), 3)
            bare = trials(lambda: bare_hop_ms(500), 3)
            more = f", of three; a process that does nothing else: {statistics.median(bare):.2g} ms"
            tell("the guard's hop, median", statistics.median(hops), 0.3, "ms", more)
        rss_mb, share = asyncio.run(cost(Path(base) / "flight"))
        tell("the guard's RSS in a flight", rss_mb, 80.0, "MB")
        tell("the guard's share of a core in a flight", 100.0 * share, 3.0, "%")


if __name__ == "__main__":
    main()
