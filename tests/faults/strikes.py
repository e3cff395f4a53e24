"""How each fault is done to a run in virtual time."""

import asyncio
import contextlib
import os
import resource
import subprocess
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.faults import hostile
from tests.faults.draws import Fault
from tests.faults.mortal_loop import MortalLoop
from wil_campaign.orchestrator.recording.timestamps import VIRTUAL_EPOCH_S
from wil_campaign.orchestrator.run.vehicles import vehicle_backends
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.plugins.signed_links.signed_link import SignedLink
from wil_campaign.plugins.signed_links.signing_key import key_from_environment
from wil_campaign.vehicles.links.link import Link

KEY = "WIL_FAULTS_KEY"
_REMEMBERED = 4000
_JUMP_S = 86400.0
_ORDERS = ("position", "send")


class Strike:
    """One fault in one run: strikes, and takes back what may be taken back."""

    def __init__(self, fault: Fault, pair: VehiclePair, folder: Path) -> None:
        self.fault = fault
        self.hit = "nobody"
        self.killed: set[asyncio.Task[Any]] = set()
        self._pair: Any = pair
        self._folder = folder
        self._rng = np.random.default_rng([fault.seed, 24])
        self._heard: dict[str, deque[bytes]] = {}
        self._undo: list[Callable[[], object]] = []
        if fault.victim == "replayed":
            self._listen()

    def vehicle(self, name: str) -> None:
        """Kill a vehicle, or stop it: it neither flies nor hears."""
        self.hit = name
        vehicle = self._pair.vehicles[name]
        vehicle.kill()
        self._later(lambda: _revive(vehicle))

    def guard(self) -> None:
        """Kill the guard, or stop it: it neither passes anything on nor acts."""
        self.hit = "guard"
        guard: Any = self._pair.guard
        if self.fault.kind == "kill":
            guard._apply = lambda *_: None
            return
        kept: list[Callable[[], object]] = []
        guard._timer.cancel()
        for ends in guard._links.values():
            for link in (ends.vehicle, ends.orchestrator):
                _hold_back(link, kept)
        for name in _ORDERS:
            setattr(guard, name, _keep_call(getattr(guard, name), kept))
        self._later(lambda: _revive_guard(guard, kept))

    def orchestrator(self, loop: MortalLoop, spared: set[asyncio.Task[Any]]) -> None:
        """Kill or stop all that is neither the guard nor a vehicle."""
        self.hit = "orchestrator"
        guard: Any = self._pair.guard
        listeners = tuple(guard._listeners)
        told: list[Any] = []
        guard._listeners[:] = [told.append]
        record, guard._record = guard._record, None
        others = {name: ends.orchestrator._other for name, ends in guard._links.items()}
        for ends in guard._links.values():
            ends.orchestrator._other = None
        feeds = [
            (one, one._truth_callbacks[:], one._mocap._callbacks[:])
            for one in self._pair.vehicles.values()
        ]
        for one, _, _ in feeds:
            one._truth_callbacks.clear()
            one._mocap._callbacks.clear()
        loop.kill_all_but(spared)

        def go_on() -> None:
            for one, truths, mocaps in feeds:
                one._truth_callbacks.extend(truths)
                one._mocap._callbacks.extend(mocaps)
            for name, ends in guard._links.items():
                ends.orchestrator._other = others[name]
            guard._record = record
            guard._listeners[:] = listeners
            loop.thaw()
            for event in told:
                for listener in listeners:
                    listener(event)

        self._later(go_on)

    def tasks(self, loop: MortalLoop, found: set[asyncio.Task[Any]]) -> None:
        """Kill or stop tasks of the run."""
        self.hit = ", ".join(sorted(task.get_name() for task in found)) or "nobody"
        self.killed = found
        loop.kill(found)
        self._later(loop.thaw)

    def trouble(self) -> None:
        """Begin what is no death."""
        self.hit = victim = self.fault.victim
        match victim:
            case "dark real" | "dark twin" | "dark both":
                wanted = victim.removeprefix("dark ")
                for name in self._pair.vehicles:
                    if wanted in {name, "both"}:
                        self._go_dark(name)
            case "cutting program":
                self._may_break()
                self._send(hostile.cutting(), self._to_guard_as_program)
            case "disk full":
                self._fill_disk()
            case "folder read-only":
                self._make_read_only()
            case "clock jump":
                self._jump()
            case "replayed":
                for name, heard in self._heard.items():
                    burst = hostile.replayed(self._rng, heard)
                    self._send(burst, self._air(name)._take)
            case _:
                self._send(getattr(hostile, victim)(self._rng), self._to_guard_as_vehicle)

    def undo(self) -> None:
        """Put back what is not only of the run."""
        while self._undo:
            self._undo.pop()()

    def _later(self, go_on: Callable[[], None]) -> None:
        if self.fault.kind == "stop":
            asyncio.get_running_loop().call_later(self.fault.for_s, go_on)

    def _air(self, name: str) -> Any:
        """Return the guard's bare end of the link to a vehicle: what comes by air comes here."""
        return _bare(self._pair.vehicles[name]._link)._other

    def _listen(self) -> None:
        for name in self._pair.vehicles:
            air, heard = self._air(name), deque[bytes](maxlen=_REMEMBERED)
            self._heard[name] = heard
            take = air._take
            air._take = lambda data, take=take, heard=heard: (heard.append(data), take(data))

    def _go_dark(self, name: str) -> None:
        near, far = self._air(name), _bare(self._pair.vehicles[name]._link)
        for end in (near, far):
            end._take = lambda _: None
        loop = asyncio.get_running_loop()
        for end in (near, far):
            loop.call_later(self.fault.for_s, end.__dict__.pop, "_take")

    def _send(self, burst: hostile.Burst, write: Callable[[bytes], object]) -> None:
        loop = asyncio.get_running_loop()
        until_s = loop.time() + self.fault.for_s

        def send() -> None:
            for data in burst():
                write(data)
            if loop.time() < until_s:
                loop.call_later(1.0 / hostile.BURST_HZ, send)

        send()

    def _may_break(self) -> None:
        """Have the guard take the vehicles for attached ones: motors of others may be cut."""
        for supervised in self._pair.guard.core._supervised_vehicles.values():
            supervised.vehicle = replace(supervised.vehicle, attached=True)

    def _to_guard_as_vehicle(self, data: bytes) -> None:
        for name in self._pair.vehicles:
            self._air(name)._take(data)

    def _to_guard_as_program(self, data: bytes) -> None:
        for link in self._pair.links.values():
            link.write(data)

    def _fill_disk(self) -> None:
        """Let no file of this process grow: works for everybody, where a full disk needs root."""
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
        self._undo.append(lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard)))

    def _make_read_only(self) -> None:
        """Let no file be made: by a mount for root, whom no mode binds, else by the mode."""
        folder = self._folder
        if os.geteuid() == 0:
            for words in (("--bind", folder, folder), ("-o", "remount,bind,ro", folder)):
                subprocess.run(["mount", *map(str, words)], check=True)  # noqa: S603, S607
            self._undo.append(
                lambda: subprocess.run(["umount", "-l", str(folder)], check=True)  # noqa: S603, S607
            )
            return
        folder.chmod(0o500)
        self._undo.append(lambda: folder.chmod(0o700))

    def _jump(self) -> None:
        """Step the wall clock: back on odd seeds, else on."""
        real, step_s = time.time, (-_JUMP_S if self.fault.seed % 2 else _JUMP_S)
        time.time = lambda: real() + step_s
        self._undo.append(lambda: setattr(time, "time", real))


@contextlib.contextmanager
def signing_vehicles() -> Iterator[None]:
    """Have embedded vehicles sign what they send, and believe only what is signed."""
    os.environ[KEY] = "passphrase:of the fault campaign"
    plain = vehicle_backends.InProcessBackend.link

    def link(self: Any, vehicle: Any) -> Link:
        near = plain(self, vehicle)
        far = self._far[vehicle.name]
        self._far[vehicle.name] = SignedLink(
            link=far, key=key_from_environment(KEY), utc_s=VIRTUAL_EPOCH_S, link_id=1
        )
        return near

    vehicle_backends.InProcessBackend.link = link  # type: ignore[method-assign]
    try:
        yield
    finally:
        vehicle_backends.InProcessBackend.link = plain  # type: ignore[method-assign]


def _bare(link: Any) -> Any:
    return link._link if isinstance(link, SignedLink) else link


def _revive(vehicle: Any) -> None:
    """Let a stopped vehicle go on: it is far behind, and drops the time that it lost."""
    vehicle._alive = True
    vehicle._timer = vehicle._loop.call_soon(vehicle._tick)


def _hold_back(link: Any, kept: list[Callable[[], object]]) -> None:
    receiver = link._receiver
    link._guard_hears = receiver
    link._receiver = lambda data, _: kept.append(
        lambda: receiver(data, asyncio.get_running_loop().time())
    )


def _keep_call(
    call: Callable[..., object], kept: list[Callable[[], object]]
) -> Callable[..., None]:
    return lambda *args: kept.append(lambda: call(*args))


def _revive_guard(guard: Any, kept: list[Callable[[], object]]) -> None:
    """Let a stopped guard go on: first it takes all that came meanwhile."""
    for name in _ORDERS:
        delattr(guard, name)
    for ends in guard._links.values():
        for link in (ends.vehicle, ends.orchestrator):
            link._receiver = link._guard_hears
    for call in kept:
        call()
    guard._schedule(1)
