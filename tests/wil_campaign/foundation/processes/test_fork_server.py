"""A fork server starts what a program's own start would, and where it cannot, that does."""

import ast
import asyncio
import os
import signal
import socket
import subprocess
import sys
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

import psutil
import pytest

from wil_campaign.foundation.processes import child as child_module
from wil_campaign.foundation.processes import fork_server
from wil_campaign.foundation.processes.child import ChildProcess, exit_status_text
from wil_campaign.foundation.processes.feed_socket import feed_environment, feed_pair
from wil_campaign.foundation.processes.fork_server import UNKNOWN_EXIT, ForkServer
from wil_campaign.vehicles.embedded.emulations import load_kernels
from wil_campaign.vehicles.embedded.process.embedded_launch import FeedClient
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings
from wil_campaign.vehicles.vehicle_server_process import (
    VehicleServerProcess,
    vehicle_program,
)

ROOT = Path(__file__).parents[4]
PROGRAM = (sys.executable, "-P", "-m", "no_such_program")
"""What the server forks; started by itself it ends with exit code 1."""
SERVER = """
import socket, sys
from wil_campaign.foundation.processes.fork_server import serve_forks
def run(arguments):
    exec(arguments[0])
    return int(arguments[1])
sys.exit(serve_forks(socket.socket(fileno=int(sys.argv[1])), run, words=4))
"""
PATIENT_S = 120.0


class Server:
    """A fork server; it is ready when a first process of it has ended."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self.process = subprocess.Popen(  # noqa: S603 - our own interpreter
                [sys.executable, "-c", SERVER, str(theirs.fileno()), " " * 2000],
                pass_fds=(theirs.fileno(),),
                env={**os.environ, "PYTHONPATH": str(ROOT)},
            )
        self.end = ours.detach()
        self.client = ForkServer(self.end, PROGRAM)

    @property
    def environment(self) -> dict[str, str]:
        return {**os.environ, "PYTHONPATH": str(ROOT)}

    def is_parent(self, pid: int | None) -> bool:
        return pid is not None and psutil.Process(pid).ppid() == self.process.pid


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fork_server, "READY_S", PATIENT_S)
    monkeypatch.setattr(child_module, "_CODE_S", PATIENT_S)


@asynccontextmanager
async def serving() -> AsyncIterator[Server]:
    server = Server()
    try:
        yield server
    finally:
        server.process.kill()
        server.process.wait()
        server.client.close()


async def forked(
    server: Server,
    code: str,
    exit_code: int = 0,
    *,
    stdin: int | None = None,
    inherited: Sequence[int] = (),
    more: dict[str, str] | None = None,
) -> ChildProcess:
    process = ChildProcess(
        argv=(*PROGRAM, code, str(exit_code)),
        environment={**server.environment, **(more or {})},
        stdin=stdin,
        inherited=inherited,
        grace_s=PATIENT_S,
    )
    await process.start_by(server.client)
    return process


async def ended(process: ChildProcess) -> int | None:
    code = await process.wait(PATIENT_S)
    await process.end()
    return code


@pytest.mark.usefixtures("patient")
async def test_a_forked_process_equals_a_started_one(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    stdin, words = os.pipe()
    code = (
        "import os, signal, sys\n"
        f"said = [input(), os.environ['WIL_CAMPAIGN_TEST'], os.getcwd(), sys.argv[4] != '',\n"
        "        os.getsid(0) == os.getpid() == os.getpgid(0), oct(os.umask(0)),\n"
        "        signal.getsignal(signal.SIGTERM) == signal.SIG_DFL,\n"
        "        signal.getsignal(signal.SIGINT) == signal.default_int_handler,\n"
        "        sorted(int(one) for one in os.listdir('/proc/self/fd'))]\n"
        f"os.write({writing}, repr(said).encode())\n"
        "print('dropped')\n"
        "print('no gate in sight', file=sys.stderr)\n"
    )
    async with serving() as server:
        process = await forked(
            server,
            code,
            3,
            stdin=stdin,
            inherited=(writing,),
            more={"WIL_CAMPAIGN_TEST": "of this process"},
        )
        assert server.is_parent(process.pid)
        os.write(words, b"asked for\n")  # it has not ended before
        assert await ended(process) == 3
    assert process.stderr_tail == "no gate in sight"
    mask = os.umask(0)
    os.umask(mask)
    os.set_blocking(reading, False)
    said = ast.literal_eval(os.read(reading, 4096).decode())
    *all_but_listing, _ = said[-1]
    assert said[:-1] == [
        *("asked for", "of this process", str(Path.cwd()), True, True, oct(mask), True, True)
    ]
    assert set(all_but_listing) <= {0, 1, 2, writing, *range(3, 6)}
    assert {0, 1, 2, writing} <= set(said[-1])
    assert len(said[-1]) == 5  # with that of the listing itself
    for one in (reading, writing, stdin, words):
        os.close(one)


@pytest.mark.usefixtures("patient")
async def test_its_command_line_is_the_programs() -> None:
    async with serving() as server:
        process = await forked(server, "import time; time.sleep(60)")
        assert process.pid is not None
        wanted = [*PROGRAM, "import time; time.sleep(60)", "0"]
        async with asyncio.timeout(PATIENT_S):  # it is the server's until it runs
            while " ".join(psutil.Process(process.pid).cmdline()).rstrip() != " ".join(wanted):  # noqa: ASYNC110 - another process
                await asyncio.sleep(0.02)
        await process.end()
    assert exit_status_text(process.exit_code) == "was ended by SIGTERM"


@pytest.mark.usefixtures("patient")
async def test_an_exception_is_printed_and_a_killed_process_is_known() -> None:
    async with serving() as server:
        process = await forked(server, "raise ValueError('of the program')")
        assert await ended(process) == 1
        assert process.stderr_tail.endswith("ValueError: of the program")
        left = await forked(server, "raise SystemExit(7)")
        assert await ended(left) == 7
        killed = await forked(server, "import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
        assert await ended(killed) == -signal.SIGKILL


@pytest.mark.usefixtures("patient")
async def test_a_child_of_it_is_ended_with_it() -> None:
    async with serving() as server:
        process = await forked(
            server,
            "import os, sys, time\n"
            "if os.fork() == 0: time.sleep(600)\n"
            "print('forked', file=sys.stderr, flush=True); time.sleep(600)",
        )
        async with asyncio.timeout(PATIENT_S):
            while "forked" not in process.stderr_tail:  # noqa: ASYNC110 - another process
                await asyncio.sleep(0.02)
        assert process.pid is not None
        below = psutil.Process(process.pid).children()
        await process.end()
        assert len(below) == 1
        assert not below[0].is_running() or below[0].status() == psutil.STATUS_ZOMBIE


@pytest.mark.usefixtures("patient")
async def test_another_environment_is_refused_and_the_program_started() -> None:
    async with serving() as server:
        process = await forked(server, "pass", more={"MAV_IGNORE_CRC": "1"})
        assert not server.is_parent(process.pid)
        assert await ended(process) == 1  # there is no such program
        assert "no_such_program" in process.stderr_tail


@pytest.mark.usefixtures("patient")
async def test_without_a_server_the_program_is_started() -> None:
    async with serving() as server:
        server.process.kill()
        server.process.wait()
        process = await forked(server, "pass")
        assert await ended(process) == 1
        assert "no_such_program" in process.stderr_tail


async def test_a_server_that_is_not_ready_is_not_waited_for(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What it forks later does not run the program a second time."""
    monkeypatch.setattr(fork_server, "READY_S", 0.2)
    async with serving() as server:
        server.process.send_signal(signal.SIGSTOP)
        process = await forked(server, f"open({str(tmp_path / 'run')!r}, 'w')")
        assert await ended(process) == 1
        monkeypatch.setattr(fork_server, "READY_S", PATIENT_S)
        server.process.send_signal(signal.SIGCONT)
        assert await ended(await forked(server, "pass", 5)) == 5  # it had the first one before
    assert not (tmp_path / "run").exists()


@pytest.mark.usefixtures("patient")
async def test_a_process_outlives_its_server_and_its_end_is_seen() -> None:
    async with serving() as server:
        process = await forked(server, "input()", stdin=(pipe := os.pipe())[0])
        server.process.kill()
        server.process.wait()
        assert process.running
        os.close(pipe[0])
        os.close(pipe[1])
        assert await ended(process) == UNKNOWN_EXIT


@pytest.mark.usefixtures("patient")
async def test_signals_end_no_server_but_the_end_of_its_clients_does() -> None:
    async with serving() as server:
        assert await ended(await forked(server, "pass")) == 0
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            server.process.send_signal(number)
        assert await ended(await forked(server, "pass", 4)) == 4
        server.client.close()
        assert await asyncio.to_thread(server.process.wait, PATIENT_S) == 0


@pytest.mark.usefixtures("patient")
async def test_embedded_vehicles_are_forked_and_fly() -> None:
    """Each with its own feed, and none with the other's."""
    load_kernels()
    server = VehicleServerProcess()
    server.start()
    client = ForkServer(os.dup(server.descriptor), vehicle_program())
    try:
        async with AsyncExitStack() as stack:
            first, second = [
                await flying_vehicle(stack, client, name) for name in ("px4", "ardupilot")
            ]
            await first.end()
            assert (first.exit_code, second.running) == (0, True)
    finally:
        client.close()
        await server.close()


async def flying_vehicle(stack: AsyncExitStack, client: ForkServer, name: str) -> ChildProcess:
    settings = ProcessSettings.model_validate(
        {"autopilot": name, "link": "udpout://127.0.0.1:9", "seed": 1, "end_with_parent": False}
    )
    ours, theirs = feed_pair()
    feed = await stack.enter_async_context(FeedClient(source="real", end=ours))
    with theirs:
        process = ChildProcess(
            argv=(*vehicle_program(), settings.model_dump_json()),
            environment={**os.environ, **feed_environment(theirs.fileno())},
            inherited=(theirs.fileno(),),
            grace_s=PATIENT_S,
        )
        await process.start_by(client)
    stack.push_async_callback(process.end)
    assert process.pid is not None
    assert psutil.Process(process.pid).ppid() != os.getpid()
    async with asyncio.timeout(PATIENT_S):
        await feed.connected.wait()
    return process
