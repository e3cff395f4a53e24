"""What a faulty flight needs around it, and what is done to it that is no signal."""

import asyncio
import contextlib
import json
import os
import resource
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import ExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.faults import hostile
from tests.faults.inspection import processes_of, vehicle_ports
from tests.faults.real_draws import RealFault
from tests.orchestrator.external.test_external_flights import drawn_by, sets, simulator
from tests.orchestrator.wall_runs import ROOT, Program
from tests.plugins.mqtt.mosquitto import MOSQUITTO
from tests.plugins.programs.test_program_flights import FLY
from tests.ports import free_port
from wil_campaign.foundation.processes.identity import ProcessId

_HOSTILE_S = 4.0
_JUMP_S = 86400.0
_DISK_MB = 400
_BROKER = """
import asyncio, sys
from amqtt.broker import Broker
ANYBODY = {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}}
async def main():
    listener = {"type": "tcp", "bind": f"127.0.0.1:{sys.argv[1]}"}
    broker = Broker({"listeners": {"default": listener}, "plugins": ANYBODY})
    await broker.start()
    await asyncio.Event().wait()
asyncio.run(main())
"""


@dataclass(frozen=True, slots=True)
class Around:
    """What a campaign has outside. arguments: that make it use it; pids: that are not its own."""

    arguments: tuple[str, ...] = ()
    pids: Mapping[str, ProcessId] = field(default_factory=dict)
    broker: int = 0


@asynccontextmanager
async def environment(fault: RealFault, folder: Path) -> AsyncIterator[Around]:
    """Start what a victim outside of the campaign is."""
    if "broker" in fault.victim or "MQTT" in fault.victim:
        port = free_port()
        with broker_process(port) as process:
            arguments = ("--broker", f"mqtt://127.0.0.1:{port}")
            yield Around(arguments, _named("broker", process.pid), port)
    elif fault.victim == "source":
        async with simulator() as (address, process):
            yield Around(sets(drawn_by(address, 700)), _named("source", process.pid))
    elif fault.victim == "autonomy":
        script = folder / "pilot_program.py"
        script.write_text(textwrap.dedent(FLY))
        command = json.dumps([sys.executable, str(script)])
        yield Around(sets(f"autonomy={{program: {command}}}"))
    else:
        yield Around()


@contextmanager
def broker_process(port: int) -> Iterator["subprocess.Popen[bytes]"]:
    """Run a broker that lets everybody in: mosquitto, or what we embed where there is none."""
    if MOSQUITTO is not None:
        words = [MOSQUITTO, "-p", str(port)]
    else:
        words = [sys.executable, "-c", _BROKER, str(port)]
    with subprocess.Popen(words, cwd=ROOT, stderr=subprocess.DEVNULL) as process:  # noqa: S603
        try:
            for _ in range(500):
                with socket.socket() as one:
                    if one.connect_ex(("127.0.0.1", port)) == 0:
                        break
                time.sleep(0.02)
            yield process
        finally:
            process.kill()


def _named(name: str, pid: int) -> dict[str, ProcessId]:
    known = ProcessId.of(pid)
    return {} if known is None else {name: known}


@contextmanager
def place_for_results(fault: RealFault, folder: Path) -> Iterator[Path]:
    """Give the folder that a flight is told to write to, as the fault wants it."""
    out = folder / "out"
    out.mkdir()
    with ExitStack() as stack:
        if fault.victim == "disk full" and _root():
            _mount(stack, out, "-t", "tmpfs", "-o", f"size={_DISK_MB}m", "tmpfs")
        elif fault.victim == "read-only from the start":
            read_only(stack, out)
        yield out


def read_only(stack: ExitStack, folder: Path) -> None:
    """Let nothing be made in a folder; by a mount for root, whom no mode binds."""
    if _root():
        _mount(stack, folder, "--bind", str(folder))
        _run("mount", "-o", "remount,bind,ro", str(folder))
    else:
        folder.chmod(0o500)
        stack.callback(folder.chmod, 0o700)


def _root() -> bool:
    return os.geteuid() == 0


def _mount(stack: ExitStack, where: Path, *words: str) -> None:
    _run("mount", *words, str(where))
    stack.callback(_run, "umount", "-l", str(where))


def _run(*words: str) -> None:
    subprocess.run(words, check=True)  # noqa: S603


async def trouble(
    fault: RealFault, program: Program, around: Around, step: Path, stack: ExitStack
) -> None:
    """Do what is no signal to a flight. step: the file with the wall clock's step."""
    rng = np.random.default_rng([fault.seed, 26])
    match fault.victim:
        case "disk full":
            _fill(program)
        case "folder read-only":
            read_only(stack, program.folder)
        case "clock back" | "clock on":
            _step_clock(step, _JUMP_S if fault.victim == "clock on" else -_JUMP_S)
        case "garbage by MQTT":
            await _garbage_by_mqtt(program, around.broker, rng)
        case "garbage at the socket":
            await asyncio.to_thread(_garbage_at_sockets, program, rng)
        case "replayed":
            bursts = {
                name: hostile.replayed(rng, frames_of(program.run_folder() / f"{name}.tlog"))
                for name in ("real", "twin")
            }
            await _send_to_guard(program, bursts)
        case _:
            burst = getattr(hostile, fault.victim)(rng)
            await _send_to_guard(program, {"real": burst, "twin": burst})


def _step_clock(step: Path, by_s: float) -> None:
    step.write_text(str(by_s))


def _fill(program: Program) -> None:
    """Fill the disk: a small one of its own for root, else no file may grow any more."""
    if not _root():
        for pid in processes_of(program.runtime):
            _, hard = resource.prlimit(pid, resource.RLIMIT_FSIZE)
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (0, hard))
        return
    with contextlib.suppress(OSError), (program.out / "filler").open("wb", buffering=0) as filler:
        while filler.write(bytes(1 << 16)):
            pass


async def _send_to_guard(program: Program, bursts: Mapping[str, hostile.Burst]) -> None:
    """Send to the ports where the guard hears the vehicles, from a port of our own."""
    ports = vehicle_ports(program.runtime)
    until_s = time.monotonic() + _HOSTILE_S
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        while time.monotonic() < until_s and program.process.returncode is None:
            for name, burst in bursts.items():
                for data in burst():
                    for at in range(0, len(data), 1400):
                        where = ("127.0.0.1", ports.get(name, 9))
                        sender.sendto(data[at : at + 1400], where)
            await asyncio.sleep(1.0 / hostile.BURST_HZ)


def frames_of(tlog: Path) -> list[bytes]:
    """Return a vehicle's own frames of a .tlog that is being written, cut at its end or not."""
    data, at, frames = tlog.read_bytes(), 0, []
    while at + 20 <= len(data):
        at += 8
        length = 12 + data[at + 1] + (13 if data[at + 2] & 1 else 0)
        frames.append(data[at : at + length])
        at += length
    return [frame for frame in frames if frame[5] in {1, 2} and frame[6] == 1][-4000:]


async def _garbage_by_mqtt(program: Program, port: int, rng: np.random.Generator) -> None:
    import aiomqtt

    session = program.folder.name
    wrong = {"signature": "0" * 64, "session": session, "id": "x1", "at": time.time(), "who": "eve"}
    payloads: list[bytes] = [
        b"",
        b"abort",
        b"\xff\xfe\x00\x01",
        b"[" * 5000,
        b'{"token": null}',
        bytes(1 << 20),
        rng.integers(0, 256, size=3000, dtype=np.uint8).tobytes(),
        json.dumps(wrong).encode(),
        json.dumps({**wrong, "at": 1e400}).encode(),
        json.dumps({"token": {"a": []}, "id": 7, "at": "now", "who": ["x"]}).encode(),
    ]
    async with aiomqtt.Client("127.0.0.1", port) as client:
        for _ in range(20):
            for kind in ("abort", "hold", "resume", "geofence", "nonsense", "abort/x"):
                for payload in payloads:
                    topic = f"wil/gate/operator/{kind}"
                    await client.publish(topic, payload, qos=0, retain=kind == "hold")
            await asyncio.sleep(0.05)


def _garbage_at_sockets(program: Program, rng: np.random.Generator) -> None:
    """Say nonsense to the guard's and the campaign's sockets, and hang up in between."""
    lines = [b"\n", b"{}\n", b"\xff\n", b"[" * 9000 + b"\n", b"x" * 100_000 + b"\n"]
    lines += [b'{"command": "abort it"}\n', b'{"command": ["abort"]}\n', b'"abort"\n']
    for path in (program.runtime / "wil-campaign").glob("*.sock"):
        for _ in range(60):
            with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as one:
                one.settimeout(0.2)
                one.connect(str(path))
                one.sendall(lines[int(rng.integers(len(lines)))])
