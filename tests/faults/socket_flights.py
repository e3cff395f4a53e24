"""Flights that must fail, of real processes: relays alter what comes from vehicle and simulator.

`python -m tests.faults.socket_flights FIRST COUNT FOLDER` prints one JSON object for each flight.
The vehicle that is judged is attached: nothing but MAVLink and motion capture says where it is.
"""

import asyncio
import contextlib
import json
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.faults.alterations import (
    MESSAGES,
    POSSIBLE,
    reading_change,
    signal_change,
)
from tests.faults.field_faults import BOARD, draw_field
from tests.faults.ground_station import SENDS, TAKES_OVER, messages
from tests.faults.missions import CAUSES, mission_of, write_mission, write_profile
from tests.faults.relay import ESTIMATOR_REPORTS, without_position
from tests.faults.signals import (
    JUDGED_BESIDE,
    LOST_AFTER_S,
    Outcome,
    SignalFault,
    draw,
    shown_by_none,
)
from tests.faults.socket_relay import CaptureRelay, MavlinkRelay, PictureRelay, Receiver
from tests.faults.wire_changes import OTHERS, WireFault
from tests.orchestrator.wall_runs import ROOT, stages
from tests.ports import free_port
from tests.vehicles.embedded.running_vehicle import running_vehicle
from wil_campaign.orchestrator.state.run_state import Stage
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import MavlinkFrame

_SIGNALS = (
    *("position",) * 5,
    *("velocity",) * 2,
    *("mocap",) * 7,
    *("picture",) * 4,
    *("attitude", "heartbeat", "landed_state", "link", "process", "timesync"),
)
SECOND_VEHICLE = "a second vehicle"
"""Another board with the same system id, behind the same router: it obeys what it hears."""
_ON_THE_WIRE = frozenset({"heading", "estimator's hold", "second sender"})
_OF_THE_FIELD = _ON_THE_WIRE | {"ground station"}
_STATION_EVERY_S = 0.2
_ENDS_WITHIN_S = 300.0
_SIZE_PX = (96, 72)
_PATIENT = {f"max_{what}_skew_s": 10 for what in ("command", "takeoff", "t0")}


@dataclass(frozen=True, slots=True)
class _Result:
    verdict: str
    reason: str
    decided_by: str


def draw_on_sockets(seed: int) -> SignalFault:
    """Return the fault of a seed; what is judged is attached, and nothing else knows it.

    Every other one is a fault of the field.
    """
    return _draw_signal(seed) if seed % 2 else _draw_field(seed)


def _draw_field(seed: int) -> SignalFault:
    """Return a fault of the field that no flight has to be spared for."""
    rng = np.random.default_rng([seed, 44])
    others = (draw_field(int(rng.integers(1_000_000, 2_000_000))) for _ in range(1_000))
    drawn = next(one for one in others if one.signal in _OF_THE_FIELD)
    said_by_others = {*OTHERS, *SENDS} - set(TAKES_OVER)
    if drawn.cause == "none" and drawn.kind in said_by_others:
        drawn = replace(drawn, cause=CAUSES[int(rng.integers(len(CAUSES)))])
    pair = rng.random() < 0.1
    drawn = replace(
        drawn,
        seed=seed,
        mode="wil" if pair else "sim",
        vehicle="real" if pair else "twin",
        judged_by="mavlink",
        lone=True,
    )
    if drawn.signal == "second sender" and rng.random() < 0.3:
        alteration = replace(drawn.alteration, kind=SECOND_VEHICLE)
        return replace(drawn, stage="start", after_s=0.0, alteration=alteration)
    return drawn


def _draw_signal(seed: int) -> SignalFault:
    rng = np.random.default_rng([seed, 37])
    drawn = draw(seed + 1_000_000)
    signal_ = _SIGNALS[int(rng.integers(len(_SIGNALS)))]
    if drawn.cause in JUDGED_BESIDE and rng.random() < 1 / 3:
        signal_ = JUDGED_BESIDE[drawn.cause]
    kinds = POSSIBLE[signal_]
    pair = signal_ == "picture" or rng.random() < 0.2
    kind = kinds[seed % len(kinds)]
    return replace(
        drawn,
        seed=seed,
        mode="wil" if pair else "sim",
        vehicle=("twin" if signal_ == "picture" else "real") if pair else "twin",
        signal=signal_,
        judged_by="mocap" if signal_ == "mocap" or rng.random() < 0.3 else "mavlink",
        lone=True,
        alteration=replace(drawn.alteration, kind=kind),
    )


async def inject(
    fault: SignalFault, folder: Path, *, disturbed: bool = True, stall_s: float | None = None
) -> Outcome:
    """Fly a flight that must fail with a fault in it, or without; the folder is there.

    stall_s: for how long motion capture may miss the vehicle, or repeat a pose; by default as long
    as in every campaign.
    """
    flight = _Flight(fault, folder, disturbed=disturbed, stall_s=stall_s)
    result = await flight.fly()
    exempt = disturbed and shown_by_none(fault)
    wrong = result.verdict == "PASS" and not exempt
    return Outcome(fault, result.verdict, result.reason, result.decided_by, exempt, wrong)


class _Flight:
    """One flight: relays, the vehicle behind them, and the program before them."""

    def __init__(
        self, fault: SignalFault, folder: Path, *, disturbed: bool, stall_s: float | None
    ) -> None:
        self._fault, self._folder, self._disturbed = fault, folder, disturbed
        self._stall_s = stall_s
        self._active = self._position_is_lost = False
        self._vehicle: asyncio.subprocess.Process | None = None

    async def fly(self) -> _Result:
        """Fly it to its end."""
        async with AsyncExitStack() as stack:
            campaign = await self._open_environment(stack)
            program = await stack.enter_async_context(self._program(campaign))
            begin = asyncio.gather(self._begin(), self._lose_position())
            try:
                async with asyncio.timeout(_ENDS_WITHIN_S):
                    out, err = await program.communicate()
            except TimeoutError:
                return _Result("ERROR", f"the program had not ended after {_ENDS_WITHIN_S} s", "")
            finally:
                begin.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await begin
        try:
            (run,) = json.loads(out)["runs"]
        except (ValueError, KeyError):
            return _Result("ERROR", f"no summary: {err.decode()[-400:]}", "")
        return _Result(run["verdict"], run["reason"], run.get("decided_by", ""))

    async def _open_environment(self, stack: AsyncExitStack) -> Path:
        """Start relays, vehicle and simulator; return the campaign that uses them."""
        fault, subject = self._fault, self._fault.subject
        mavlink_port, capture_port = free_port(), free_port()
        own = self._own_report if fault.cause == "estimator" else None
        if fault.signal in _ON_THE_WIRE:
            board = BOARD[fault.autopilot]
            wire = WireFault(fault.kind, self._is_on, fault.alteration.offset_m, board)
            mavlink = MavlinkRelay(
                lambda frame: ((0.0, raw) for raw in wire.change(frame)),
                None,
                lambda: self._disturbed and fault.kind != SECOND_VEHICLE,
                own=own,
            )
        else:
            ids = MESSAGES.get(fault.signal, ()) or None
            mavlink = MavlinkRelay(
                signal_change(fault.signal, fault.alteration),
                ids,
                lambda: self._is(*MESSAGES.keys()),
                own=own,
            )
        capture = CaptureRelay(
            reading_change(fault.alteration), lambda: self._is("mocap"), body=subject
        )
        await stack.enter_async_context(mavlink.running(mavlink_port))
        await stack.enter_async_context(capture.running(capture_port))
        keys: dict[str, Any] = {"seed": 1 + fault.seed}
        vehicle: dict[str, Any] = {"link": f"udpin://127.0.0.1:{mavlink_port}"}
        if fault.judged_by == "mocap":
            vehicle["mocap"] = {"address": f"udp://127.0.0.1:{capture_port}"}
            if self._stall_s is not None:
                vehicle["mocap"]["stall_s"] = self._stall_s
        path = write_mission(
            self._folder,
            fault.cause,
            mode=fault.mode,
            autopilot=fault.autopilot,
            judged_by=fault.judged_by,
            keys={**keys, "sync": _PATIENT, "preflight": {"failsafe": "set"}},
        )
        # What it flies in is its own process's to know.
        vehicle["profile"] = "nominal"
        sets = {f"vehicles.{subject}.{key}": value for key, value in vehicle.items()}
        if fault.signal == "ground station" and self._disturbed:
            port = await stack.enter_async_context(self._station())
            sets[f"operator.gcs.{subject}"] = f"udpout://127.0.0.1:{port}"
        if fault.mode == "wil":
            sets["recipe.combine.0.max_skew_ms"] = 800
            pictures = PictureRelay(fault.alteration, lambda: self._is("picture"), _SIZE_PX)
            address = await stack.enter_async_context(_simulator(self._folder / "world.yaml"))
            await stack.enter_async_context(pictures.running(address))
            source = {"address": pictures.address, "answer_ms": 700}
            sets["vehicles.twin.sensors.camera.source"] = source
        self._sets = [
            word for key, value in sets.items() for word in ("--set", f"{key}={json.dumps(value)}")
        ]
        self._vehicle = await stack.enter_async_context(
            _vehicle(fault, self._folder, mavlink_port=mavlink.port, feed_port=capture.port)
        )
        if fault.kind == SECOND_VEHICLE and self._disturbed:
            other = replace(fault, seed=fault.seed + 1)
            await stack.enter_async_context(
                _vehicle(other, self._folder, mavlink_port=mavlink.port, feed_port=free_port())
            )
        # Its process may begin later than a program waits for a vehicle.
        async with asyncio.timeout(60.0):
            await mavlink.heard.wait()
        return path

    @asynccontextmanager
    async def _program(self, campaign: Path) -> AsyncIterator[asyncio.subprocess.Process]:
        runtime = Path(tempfile.mkdtemp(prefix="wil-"))
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "wil_campaign", "run", str(campaign)),
            *("--clock", "wall", "--jobs", "1", "--json", "--arm-real"),
            *("--out", str(self._folder / "out"), *self._sets),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            cwd=ROOT,
            env={
                **os.environ,
                "PYTHONPATH": str(ROOT),
                "XDG_RUNTIME_DIR": str(runtime),
                "XDG_STATE_HOME": str(self._folder / "state"),
            },
            start_new_session=True,
        )
        try:
            yield process
        finally:
            if process.returncode is None:
                process.terminate()
                await process.communicate()
            shutil.rmtree(runtime)

    @asynccontextmanager
    async def _station(self) -> AsyncIterator[int]:
        """Send by the guard's port for ground stations once the fault is active; gives the port."""
        fault = self._fault
        codec = MavlinkCodec(system_id=255, component_id=190)
        system = 1 if fault.subject == "real" else 2
        loop = asyncio.get_running_loop()
        transport, guard = await loop.create_datagram_endpoint(
            lambda: Receiver(lambda _: None), local_addr=("127.0.0.1", 0)
        )

        async def send() -> None:
            while True:
                await asyncio.sleep(_STATION_EVERY_S)
                sent = messages(fault.kind, system, fault.autopilot) if self._is_on() else ()
                for message in sent:
                    for peer in guard.peers:
                        transport.sendto(codec.pack(message), peer)

        sending = asyncio.create_task(send())
        try:
            yield int(transport.get_extra_info("sockname")[1])
        finally:
            sending.cancel()
            transport.close()

    def _is_on(self) -> bool:
        return self._active and self._disturbed

    def _is(self, *signals: str) -> bool:
        return self._active and self._disturbed and self._fault.signal in signals

    async def _begin(self) -> None:
        """Begin the fault some time after its stage was entered."""
        fault = self._fault
        if fault.stage != "start":
            await self._stage(fault.stage)
        await asyncio.sleep(fault.after_s)
        self._active = True
        if fault.signal != "process" or not self._disturbed or self._vehicle is None:
            return
        self._vehicle.send_signal(signal.SIGKILL if fault.kind == "stop" else signal.SIGSTOP)
        await asyncio.sleep(abs(fault.alteration.step_s))
        with contextlib.suppress(ProcessLookupError):
            self._vehicle.send_signal(signal.SIGCONT)

    async def _lose_position(self) -> None:
        """Have the vehicle report that its estimator lost the position, where this is the cause."""
        await self._stage("goal")
        await asyncio.sleep(LOST_AFTER_S)
        self._position_is_lost = True

    def _own_report(self, frame: MavlinkFrame) -> MavlinkFrame:
        lost = self._position_is_lost and frame.message_id in ESTIMATOR_REPORTS
        return frame._replace(raw=without_position(frame)) if lost else frame

    async def _stage(self, stage: Stage) -> None:
        while not self._has_come(stage):  # noqa: ASYNC110 - another process sets no event of ours
            await asyncio.sleep(0.02)

    def _has_come(self, stage: Stage) -> bool:
        for log in (self._folder / "out").glob("*/*/*/*/*/log.jsonl"):
            with contextlib.suppress(OSError):
                return stage in stages(log.parent)
        return False


@asynccontextmanager
async def _vehicle(
    fault: SignalFault, folder: Path, *, mavlink_port: int, feed_port: int
) -> AsyncIterator[asyncio.subprocess.Process]:
    """Run the vehicle that is judged as a process of its own."""
    is_real = fault.subject == "real"
    mission = mission_of(fault.cause, fault.mode)
    is_own = mission.capacity_mah is not None
    profile = str(write_profile(folder, "nominal", mission)) if is_own else "nominal"
    settings = ProcessSettings(
        autopilot=fault.autopilot,
        link=f"udpout://127.0.0.1:{mavlink_port}",
        seed=fault.seed,
        running_s=60.0,
        profile=profile,
        source="real" if is_real else "twin",
        system_id=1 if is_real else 2,
        latitude_deg=47.4,
        longitude_deg=8.5,
        parameters=dict(autopilot_named(fault.autopilot).failsafes.on_silence),
        feed_port=feed_port,
    )
    async with running_vehicle(settings) as process:
        yield process


@asynccontextmanager
async def _simulator(world: Path) -> AsyncIterator[str]:
    """Run the reference simulator; gives its address."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "wil_campaign.plugins.simulator.reference_simulator"),
        *("--world", str(world), "--bind", "tcp://127.0.0.1:*"),
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=asyncio.subprocess.PIPE,
        start_new_session=True,
    )
    try:
        assert process.stdout is not None
        yield (await process.stdout.readline()).decode().strip()
    finally:
        process.kill()
        await process.wait()


def main(arguments: list[str]) -> None:
    first, count, folder = int(arguments[0]), int(arguments[1]), Path(arguments[2])
    for seed in range(first, first + count):
        (folder / str(seed)).mkdir(parents=True)
        outcome = asyncio.run(inject(draw_on_sockets(seed), folder / str(seed)))
        if not outcome.wrong:
            shutil.rmtree(folder / str(seed))
        sys.stdout.write(json.dumps(asdict(outcome)) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
