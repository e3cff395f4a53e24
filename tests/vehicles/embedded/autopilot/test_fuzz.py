"""Nothing that a client sends ends a vehicle or goes unanswered.

Messages are made from the dialect, with NaN, infinities and numbers out of range in every field:
all that the autopilots take to vehicles in flight, and all that there are to autopilots without a
body. A seeded sample is part of the suite; WIL_FUZZ_MESSAGES=100000 sends as many as it says.
"""

import asyncio
import math
import os
import random
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.embedded.autopilot.bare_autopilot import BareAutopilot

Scenario = Callable[[Any], Any]
BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])

MESSAGES = int(os.environ.get("WIL_FUZZ_MESSAGES", "600"))
BARE_MESSAGES = max(12000, MESSAGES)
PER_FLIGHT = 2500
PER_BARE = 1000
"""Each vehicle takes so many, and then a new one."""

FLOATS = (
    math.nan, math.inf, -math.inf, 0.0, -0.0, 1.0, -1.0, 0.5, 1e-45, 3.4e38, -3.4e38, 1e7, -1e7,
    473977420.0, 85455940.0, 47.39775, 8.54560, 3e6, 491.0, 2.5, 4294967296.0, 2989.0, 21196.0,
)  # fmt: skip
CHOICES = {
    "mission_type": [0, 0, 0, 1, 2, 255, 77],
    "frame": [0, 1, 3, 5, 6, 8, 9, 10, 11, 12, 255],
    "coordinate_frame": [0, 1, 3, 5, 6, 8, 9, 10, 11, 12, 255],
}
NEVER = {mavlink.MAV_CMD_DO_FLIGHTTERMINATION}
"""It ends the flight as it should; a test of its own does that."""


class Messages:
    """Makes messages of the kinds that an autopilot takes, or of all kinds, at random."""

    def __init__(
        self, autopilot: str, parameters: list[str], seed: int, *, every_kind: bool = False
    ) -> None:
        hub = BareAutopilot(autopilot).autopilot.hub
        self._rng = random.Random(seed)  # noqa: S311 - repeatable
        by_name = {each.msgname: each for each in mavlink.mavlink_map.values()}
        taken = sorted(hub.messages)
        self._kinds = [by_name[name] for name in taken]
        if every_kind:
            # Half of them such that are taken.
            self._kinds = self._kinds * (len(by_name) // len(taken)) + list(by_name.values())
        self._commands = [*sorted(set(hub.commands) - NEVER), 31000, 0, 65535]
        self._items = [16, 17, 19, 20, 21, 22, 82, 177, 178, 5000, 5001, 5003, 5100, 31000]
        self._parameters = parameters

    def next(self) -> Any:
        return self.of(self._rng.choice(self._kinds))

    def of(self, kind: Any) -> Any:
        """Return a message of this kind."""
        values = [
            self._value(kind.msgname, name, how, length)
            for name, how, length in zip(
                kind.fieldnames, self._types(kind), self._lengths(kind), strict=True
            )
        ]
        return kind(*values)

    def _types(self, kind: Any) -> list[str]:
        by_name = dict(zip(kind.ordered_fieldnames, self._ordered_types(kind), strict=True))
        return [by_name[name] for name in kind.fieldnames]

    def _ordered_types(self, kind: Any) -> list[str]:
        types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
        return [types[name] for name in kind.ordered_fieldnames]

    def _lengths(self, kind: Any) -> list[int]:
        lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
        return [lengths[name] for name in kind.fieldnames]

    def _value(self, message: str, name: str, how: str, length: int) -> Any:
        if how == "char":
            if self._rng.random() < 0.7:
                return self._rng.choice(self._parameters).encode()
            return self._rng.randbytes(length)
        if length:
            return [self._one(message, name, how) for _ in range(length)]
        return self._one(message, name, how)

    def _one(self, message: str, name: str, how: str) -> Any:
        rng = self._rng
        if name in {"target_system", "target", "target_component"}:
            return 1
        if name == "command":
            return rng.choice(self._items if message.startswith("MISSION") else self._commands)
        if name in CHOICES:
            return rng.choice(CHOICES[name])
        if name in {"seq", "count"} and rng.random() < 0.7:
            return rng.randrange(4)
        return self._number(how)

    def _number(self, how: str) -> Any:
        rng = self._rng
        if how in {"float", "double"}:
            return rng.choice(FLOATS) if rng.random() < 0.8 else rng.uniform(-1000.0, 1000.0)
        bits = int(how.strip("uint_").split("_")[0])
        low = 0 if how.startswith("u") else -(2 ** (bits - 1))
        high = low + 2**bits - 1
        return rng.choice([low, high, 0, 1, min(high, 30), rng.randint(low, high)])


ANSWERS = {
    "COMMAND_LONG": "COMMAND_ACK",
    "COMMAND_INT": "COMMAND_ACK",
    "MISSION_SET_CURRENT": "MISSION_CURRENT",
    "FILE_TRANSFER_PROTOCOL": "FILE_TRANSFER_PROTOCOL",
}
"""What must follow a message, one for one. Of missions PX4 answers nothing while it is busy."""


def answered(rig: Any, sent: dict[str, int], since: int) -> dict[str, tuple[int, int]]:
    """Return what was sent too often for its answers: the answer, how many are due and came."""
    came = [m.get_type() for _, m in rig.heard[since:]]
    due: dict[str, int] = {}
    for name, count in sent.items():
        if name in ANSWERS:
            due[ANSWERS[name]] = due.get(ANSWERS[name], 0) + count
    return {
        name: (count, came.count(name)) for name, count in due.items() if came.count(name) < count
    }


async def survive(rig_of: Any, autopilot: str, seed: int, count: int, *, flying: bool) -> None:
    async with rig_of(autopilot=autopilot, seed=seed) as r:
        if flying:
            await r.hover()
        else:
            await asyncio.sleep(3.0)
        vehicle, left = r.vehicle, count
        messages = Messages(autopilot, list(vehicle.autopilot.parameters), seed)
        while left > 0:
            sent: dict[str, int] = {}
            since, batch = len(r.heard), min(left, 10)
            for _ in range(batch):
                message = messages.next()
                sent[message.get_type()] = sent.get(message.get_type(), 0) + 1
                r.send(message)
            await asyncio.sleep(0.05)
            left -= batch
            assert vehicle._alive, f"{autopilot} {seed}: ended after {count - left} messages"
            missing = answered(r, sent, since)
            assert not missing, f"{autopilot} {seed}: {missing} after {count - left} messages"
        truth = vehicle.truth()
        assert all(map(math.isfinite, (*truth.pose.position_ned_m, *truth.velocity_ned_m_s)))
        assert await r.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 0) == 0


@BOTH
@pytest.mark.parametrize("flying", [False, True], ids=["ground", "air"])
def test_survives_and_answers_whatever_a_client_sends(
    rig: Any, virtually: Scenario, autopilot: str, flying: bool
) -> None:
    left, seed = MESSAGES // 4, 1
    while left > 0:
        count = min(left, PER_FLIGHT)
        virtually(survive(rig, autopilot, seed, count, flying=flying))
        left -= count
        seed += 1


def unanswered(bare: BareAutopilot, message: Any) -> str | None:
    """Send a message; return what should have answered it and did not."""
    due = ANSWERS.get(message.get_type())
    got = [each.get_type() for each in bare.send(message)]
    return None if due is None or got.count(due) == 1 else f"{got} answer {message}"


def bare_autopilot(autopilot: str, *, flying: bool) -> BareAutopilot:
    bare = BareAutopilot(autopilot)
    if flying:
        bare.hover()
    else:
        bare.run(3.0)
    return bare


@BOTH
@pytest.mark.parametrize("flying", [False, True], ids=["ground", "air"])
def test_an_autopilot_survives_every_message_of_the_dialect(autopilot: str, flying: bool) -> None:
    bare = bare_autopilot(autopilot, flying=flying)
    messages = Messages(autopilot, list(bare.autopilot.parameters), 1, every_kind=True)
    for kind in mavlink.mavlink_map.values():
        assert unanswered(bare, messages.of(kind)) is None
    for count in range(BARE_MESSAGES // 4):
        if count % PER_BARE == 0:
            bare = bare_autopilot(autopilot, flying=flying)
        assert unanswered(bare, messages.next()) is None
        if count % 5 == 0:
            bare.run(0.02)
    assert bare.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 0) == 0
