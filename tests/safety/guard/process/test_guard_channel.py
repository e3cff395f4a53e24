"""What waits for a packet to ride with, between orchestrator and guard, and what never does."""

import asyncio
import math
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest

from tests.safety.guard.remote_rigs import guard_config
from wil_campaign.foundation.processes.codec import ProcessMessage, ProcessMessageError
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.commands import (
    AnchorAt,
    BringDown,
    ClocksApart,
    Command,
    NewFences,
    OperatorAction,
    OrchestratorAlive,
    OrchestratorEnded,
    StartOutage,
    VehicleGone,
)
from wil_campaign.safety.guard.core.events import EventKind, GuardEvent
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.process.channel import GuardChannel, guard_channel_pair
from wil_campaign.safety.guard.process.guard_process import GuardProcess
from wil_campaign.safety.guard.process.lockstep_clock import ORCHESTRATOR
from wil_campaign.safety.guard.process.messages import (
    EventMessage,
    FrameBytes,
    OrchestratorReached,
    ToGuard,
    VehiclePosition,
    to_guard,
)
from wil_campaign.safety.guard.process.remote_guard import RemoteGuard
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.worlds.frames import Pose

AT_REST = (0.0, 0.0, 0.0)


class Ends:
    """Both ends of a channel in this loop, and the packets that went over it."""

    def __init__(self) -> None:
        self.received: list[ToGuard] = []
        ours, theirs = guard_channel_pair()
        self.sender = GuardChannel(
            ours, receives=to_guard, take=lambda _: None, closed=lambda: None
        )
        self.receiver = GuardChannel(
            theirs, receives=to_guard, take=self.received.append, closed=lambda: None
        )
        for one in (self.sender, self.receiver):
            one.open()

    async def until(self, count: int) -> None:
        """Wait until so many messages have been received."""
        async with asyncio.timeout(60.0):
            while len(self.received) < count:  # noqa: ASYNC110 - the other end sets no event
                await asyncio.sleep(0.01)

    def close(self) -> None:
        self.sender.close()
        self.receiver.close()


def position(t_s: float) -> VehiclePosition:
    return VehiclePosition(0, t_s, (0.0, 0.0, -1.0), (1.0, 0.0, 0.0, 0.0), AT_REST)


async def test_a_command_overtakes_waiting_messages_and_takes_them_along() -> None:
    ends = Ends()
    abort = OperatorAction(OperatorCommand("abort", "anna"))
    ends.sender.send_soon(position(1.0), key=0, within_s=30.0)
    ends.sender.send_soon(OrchestratorAlive(), key=OrchestratorAlive, within_s=30.0)
    ends.sender.send_soon(position(2.0), key=0, within_s=30.0)
    await asyncio.sleep(0.05)
    assert ends.received == []
    ends.sender.send(abort)
    await ends.until(3)
    assert ends.received == [abort, OrchestratorAlive(), position(2.0)]
    ends.close()


async def test_a_setpoint_that_is_limited_comes_after_the_position_that_limits_it() -> None:
    ends = Ends()
    setpoint = FrameBytes(0, 1.0, b"setpoint")
    ends.sender.send_soon(position(1.0), key=0, within_s=30.0)
    ends.sender.send(setpoint, last=True)
    await ends.until(2)
    assert ends.received == [position(1.0), setpoint]
    ends.close()


async def test_a_message_replaces_the_one_that_waits() -> None:
    ends = Ends()
    ends.sender.send_soon(position(1.0), key=0, within_s=0.05)
    ends.sender.send(position(2.0), replaces=0)
    await asyncio.sleep(0.15)
    assert ends.received == [position(2.0)]
    ends.close()


async def test_a_waiting_message_is_sent_in_time() -> None:
    ends = Ends()
    ends.sender.send_soon(position(1.0), key=0, within_s=0.05)
    await ends.until(1)
    assert ends.received == [position(1.0)]
    ends.close()


async def test_a_position_without_a_finite_time_is_garbage() -> None:
    ends = Ends()
    ends.sender.send(position(math.nan))
    ends.sender.send(OrchestratorAlive())
    await ends.until(1)
    assert ends.received == [OrchestratorAlive()]
    assert ends.receiver.garbage == 1
    ends.close()


async def test_numbers_of_numpy_travel_as_plain_ones() -> None:
    ends = Ends()
    number: Any = np.int64(1)
    t_s: Any = np.float32(1.5)
    north_m = np.float64(2.5)
    message = VehiclePosition(number, t_s, (north_m, 0.0, -1.0), (1.0, 0.0, 0.0, 0.0), AT_REST)
    ends.sender.send(message)
    await ends.until(1)
    (received,) = ends.received
    assert received == message
    assert isinstance(received, VehiclePosition)
    assert {type(one) for one in (received.t_s, *received.position_ned_m)} == {float}
    ends.close()


class Noted:
    """A channel that notes what waits and what does not."""

    def __init__(self) -> None:
        self.at_once: list[ProcessMessage] = []
        self.waiting: list[ProcessMessage] = []

    def send(self, message: ProcessMessage, *, replaces: object = None) -> None:
        self.at_once.append(message)

    def send_soon(self, message: ProcessMessage, *, key: object, within_s: float) -> None:
        assert within_s <= 0.1
        self.waiting.append(message)


@pytest.fixture
def remote(tmp_path: Path) -> tuple[RemoteGuard, Noted]:
    guard: Any = RemoteGuard(guard_config=guard_config(tmp_path))
    guard._channel = noted = Noted()
    return guard, noted


@pytest.mark.parametrize(
    ("place", "velocity", "at_once"),
    [
        ((0.0, 0.0, -1.0), AT_REST, False),
        ((0.0, 0.0, -1.0), (1.0, 0.0, 0.0), False),
        ((6.0, 0.0, -1.0), AT_REST, True),
        ((0.0, 0.0, -1.0), (8.0, 0.0, 0.0), True),
        ((math.nan, 0.0, -1.0), AT_REST, True),
    ],
)
def test_only_a_position_that_is_no_breach_waits(
    remote: tuple[RemoteGuard, Noted],
    place: tuple[float, float, float],
    velocity: tuple[float, float, float],
    *,
    at_once: bool,
) -> None:
    guard, channel = remote
    guard.position(PoseSample(1.0, "real", Pose(place), velocity))
    assert (len(channel.at_once), len(channel.waiting)) == ((1, 0) if at_once else (0, 1))


def test_a_fence_changed_in_flight_counts_beside_the_old_one(
    remote: tuple[RemoteGuard, Noted],
) -> None:
    guard, channel = remote
    small = Fence.box(north_m=(-1, 1), east_m=(-1, 1), up_m=(-1, 6))
    guard.send(NewFences("anna", {"real": small}))
    channel.at_once.clear()
    for north_m in (2.0, 0.0, 6.0):
        guard.position(PoseSample(1.0, "real", Pose((north_m, 0.0, -1.0)), AT_REST))
    assert len(channel.at_once) == 2
    assert len(channel.waiting) == 1


def test_a_fence_that_is_only_proposed_makes_no_position_urgent(
    remote: tuple[RemoteGuard, Noted],
) -> None:
    guard, channel = remote
    small = Fence.box(north_m=(-1, 1), east_m=(-1, 1), up_m=(-1, 6))
    guard.send(NewFences("anna", {"real": small}, proposed=True))
    guard.position(PoseSample(1.0, "real", Pose((2.0, 0.0, -1.0)), AT_REST))
    assert len(channel.waiting) == 1


@pytest.mark.parametrize(
    ("kind", "text", "at_once"),
    [
        ("refused", "anna: geofence: all vehicles are landing", [6.0]),
        ("refused", "anna: resume: no vehicle holds", [2.0, 6.0]),
        ("geofence", "anna changed the fence of real", [2.0, 6.0]),
    ],
)
def test_a_fence_counts_until_the_guard_has_refused_it(
    remote: tuple[RemoteGuard, Noted], kind: EventKind, text: str, at_once: list[float]
) -> None:
    guard, channel = remote
    small = Fence.box(north_m=(-1, 1), east_m=(-1, 1), up_m=(-1, 6))
    guard.send(NewFences("anna", {"real": small}, proposed=True))
    guard.send(NewFences("anna", {"real": small}))
    guard._take(EventMessage(GuardEvent(1.0, "proposed", "", "")))
    guard._take(EventMessage(GuardEvent(1.0, kind, "", text)))
    channel.at_once.clear()
    for north_m in (2.0, 0.0, 6.0):
        guard.position(PoseSample(1.0, "real", Pose((north_m, 0.0, -1.0)), AT_REST))
    sent = [one.position_ned_m[0] for one in channel.at_once if isinstance(one, VehiclePosition)]
    assert sent == at_once


SMALL = {"real": Fence.box(north_m=(-1, 1), east_m=(-1, 1), up_m=(-1, 6))}
COMMANDS: tuple[Command, ...] = (
    OrchestratorAlive(),
    OperatorAction(OperatorCommand("hold", "anna", run="large/wil/1")),
    BringDown("the flight is over"),
    NewFences("anna", SMALL),
    NewFences("bert", SMALL, proposed=True),
    AnchorAt("twin", (1.0, 2.0, 3.0), 0.5),
    StartOutage("twin", 4.0),
)
NOT_FOR_A_GUARD: tuple[Command, ...] = (
    OperatorAction(OperatorCommand("geofence", "anna", document="a file")),
    NewFences("anna", {**SMALL, "nobody": SMALL["real"]}),
    AnchorAt("nobody", (0.0, 0.0, 0.0), 0.0),
    StartOutage("nobody", 1.0),
)


def type_name(message: ProcessMessage) -> str:
    """Return a message's id in a test's name: the same in each worker."""
    return type(message).__name__


class Wired:
    """A remote guard and the process of a guard; the bytes of the one go to the other at once."""

    def __init__(self, folder: Path) -> None:
        ours, self._theirs = guard_channel_pair()
        remote: Any = RemoteGuard(guard_config=guard_config(folder))
        process: Any = GuardProcess(end=ours, lifeline=-1)
        self.remote, self.process = remote, process
        self.executed: list[object] = []
        self.notes: list[str] = []
        self.waited: list[type] = []
        remote._channel = self
        process._guard = SimpleNamespace(send=self.executed.append)
        process._names, process._links = ("real", "twin"), [object(), object()]
        process._note = lambda event, text: self.notes.append(f"{event}: {text}")

    def send(self, message: ProcessMessage) -> None:
        for received in to_guard.decode(to_guard.encode([message])):
            self.process._take(received)

    def send_soon(self, message: ProcessMessage, *, key: object, within_s: float) -> None:
        assert within_s <= 0.1
        self.waited.append(type(message))
        self.send(message)

    def close(self) -> None:
        self.process._channel.close()
        self._theirs.close()


@pytest.fixture
def wired(tmp_path: Path) -> Iterator[Wired]:
    made = Wired(tmp_path)
    yield made
    made.close()


def test_the_commands_here_are_all_that_there_are() -> None:
    assert {type(command) for command in COMMANDS} == set(get_args(Command))


@pytest.mark.parametrize("command", COMMANDS, ids=type_name)
def test_a_command_is_executed_by_the_guards_process_as_it_was_sent(
    wired: Wired, command: Command
) -> None:
    wired.process._statuses_unanswered = 9
    wired.remote.send(command)
    (executed,) = wired.executed
    assert to_guard.encode([executed]) == to_guard.encode([command])
    assert wired.process._statuses_unanswered == 0
    assert wired.notes == []
    assert wired.waited == [type(command)] * isinstance(command, OrchestratorAlive), (
        "no other command waits"
    )


@pytest.mark.parametrize("command", NOT_FOR_A_GUARD, ids=type_name)
def test_a_command_for_others_is_noted_and_not_executed(wired: Wired, command: Command) -> None:
    wired.remote.send(command)
    assert wired.executed == []
    assert wired.notes == [f"refused: {type(command).__name__} is not expected in this state"]


@pytest.mark.parametrize("command", COMMANDS, ids=type_name)
def test_a_guard_that_has_not_opened_its_links_executes_nothing(
    wired: Wired, command: Command
) -> None:
    wired.process._links = []
    wired.remote.send(command)
    assert wired.executed == []
    assert len(wired.notes) == 1


def test_the_guards_process_tells_its_clock_how_far_the_orchestrator_is(wired: Wired) -> None:
    reached: list[tuple[str, float]] = []
    wired.send(OrchestratorReached(1.0))
    wired.process._clock = SimpleNamespace(reached=lambda *row: reached.append(row))
    wired.send(OrchestratorReached(2.0))
    assert reached == [(ORCHESTRATOR, 2.0)]
    assert len(wired.notes) == 1


@pytest.mark.parametrize(
    "message",
    [OrchestratorEnded(), VehicleGone("twin", ""), ClocksApart("twin", "")],
    ids=type_name,
)
def test_what_a_guards_process_finds_itself_comes_from_no_orchestrator(
    message: ProcessMessage,
) -> None:
    with pytest.raises(ProcessMessageError):
        to_guard.decode(to_guard.encode([message]))


@pytest.mark.parametrize("ending", [False, True])
def test_the_end_of_a_vehicles_process_is_the_guards_matter_until_all_end(
    wired: Wired, *, ending: bool
) -> None:
    wired.process._ending = ending
    wired.process._note = lambda *_, **__: None
    wired.process._child_ended("twin", SimpleNamespace(exit_code=3, stderr_tail=""))
    gone = VehicleGone("twin", "twin ended: its process ended with exit code 3")
    assert wired.executed == ([] if ending else [gone])


async def test_a_guard_without_its_orchestrator_lands_all_before_it_ends(wired: Wired) -> None:
    busy = iter([("real",), ()])

    def may_be_armed(_: float) -> tuple[str, ...]:
        assert wired.executed == [OrchestratorEnded()]
        return next(busy)

    wired.process._guard.core = SimpleNamespace(may_be_armed=may_be_armed)
    wired.process._guard_config = SimpleNamespace(patience_s=60.0)
    await wired.process._last()
    assert next(busy, None) is None


@pytest.mark.parametrize(
    ("armed", "latched", "lives"),
    [((), None, [OrchestratorAlive()]), (("real",), None, []), ((), "abort", [])],
)
async def test_a_silent_orchestrator_does_no_harm_on_the_ground(
    wired: Wired, armed: tuple[str, ...], latched: str | None, lives: list[Command]
) -> None:
    guard = wired.process._guard
    guard.core = SimpleNamespace(
        may_be_armed=lambda _: armed, latched=latched, all_down=False, phases={}
    )
    guard.started_s = 0.0
    wired.process._guard_config = SimpleNamespace(patience_s=60.0)
    wired.process._loop = asyncio.get_running_loop()
    wired.process._send_status()
    wired.process._status_timer.cancel()
    assert wired.executed == lives


async def test_messages_of_a_closed_end_are_read_before_the_channel_is_closed() -> None:
    """The loop reads a packet a turn; a guard that ends sends its last events at once."""
    ends = Ends()
    for k in range(5):
        ends.sender.send(position(float(k)))
    ends.sender.close()
    ends.receiver.read_rest()
    ends.receiver.close()
    assert [one.t_s for one in ends.received if isinstance(one, VehiclePosition)] == [0, 1, 2, 3, 4]
