"""Each sign of two vehicles that arrive as one is found alone, and none of it in a single one."""

import random
import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.driver.session.second_vehicle import SecondVehicle


def second(position_hz: float = 50.0) -> SecondVehicle:
    made = SecondVehicle()
    made.position_hz = position_hz
    return made


def version(uid: int, uid2: bytes = b"") -> Any:
    return mavlink.MAVLink_autopilot_version_message(
        0, 0, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, uid, tuple(uid2.ljust(18, b"\0"))
    )


def position(boot_ms: int, north_m: float) -> bytes:
    return struct.pack("<I6f", boot_ms, north_m, 0.0, 0.0, 0.0, 0.0, 0.0)


def fly(
    found: SecondVehicle,
    *ahead_ms: int,
    seconds: float = 4.0,
    hz: float = 50.0,
    from_s: float = 0.0,
) -> str:
    """Have one vehicle or more send positions, whose clocks are ahead by so much."""
    for tick in range(round(seconds * hz)):
        t_s = from_s + tick / hz
        for number, ahead in enumerate(ahead_ms):
            payload = position(60_000 + ahead + round(t_s * 1e3), number + tick * 1e-3)
            found.position(payload, t_s + number * 0.3 / hz)
    return found.found


def test_two_uids_are_two_vehicles() -> None:
    found = second()
    for _ in range(3):
        found.version(version(7), 1.0)
    assert found.found == ""
    found.version(version(8), 2.0)
    assert "the uids 0000000000000007 and 0000000000000008" in found.found
    found = second()
    found.version(version(7, b"\1"), 1.0)
    found.version(version(7, b"\2"), 1.0)
    assert "uids" in found.found


@pytest.mark.parametrize("apart_ms", [0, 25, 370, 4_000, -20_000])
def test_twice_the_positions_by_two_clocks(apart_ms: int) -> None:
    found = second()
    texts: list[tuple[str, float]] = []
    found.on_found = lambda text, t_s: texts.append((text, t_s))
    assert "positions arrive at 100 Hz" in fly(found, 0, apart_ms)
    ((text, t_s),) = texts
    assert text == found.found
    assert t_s < 2.2


@pytest.mark.parametrize("hz", [25.0, 50.0, 200.0])
def test_one_vehicle_may_send_more_than_was_asked_for(hz: float) -> None:
    assert fly(second(), 0, hz=hz, seconds=8.0) == ""


def test_one_reboot_is_no_second_clock() -> None:
    found = second()
    fly(found, 0)
    assert fly(found, -13_000, from_s=6.0) == ""


def test_positions_that_are_overtaken_or_doubled_are_of_one_vehicle() -> None:
    rng = random.Random(1)  # noqa: S311 - repeatable
    sent = [
        (tick * 0.02 + rng.uniform(0.0, 0.1), position(tick * 20, tick * 1e-3))
        for tick in range(400)
        for _ in range(2)
    ]
    found = second()
    for t_s, payload in sorted(sent):
        found.position(payload, t_s)
    assert found.found == ""


@pytest.mark.parametrize("phase_s", [0.02, 0.3, 0.5])
def test_heartbeats_in_two_phases_are_of_two_vehicles(phase_s: float) -> None:
    found = second()
    for beat in range(6):
        found.heartbeat(b"a%d" % beat, float(beat))
        found.heartbeat(b"b%d" % beat, beat + phase_s)
    assert found.found == "heartbeats come twice a second, in two phases"


def test_heartbeats_of_one_vehicle_are_not_taken_for_two() -> None:
    """Once a second; once more at each change of mode; together after an outage; doubled."""
    for times in (
        [float(beat) for beat in range(20)],
        [0, 0.4, 1, 1.3, 2, 2.5, 3, 4, 5, 6],
        [0, 1, *[9.0 + n * 1e-3 for n in range(8)], 10, 11, 12],
    ):
        found = second()
        for count, t_s in enumerate(times):
            for _ in range(2):
                found.heartbeat(b"%d" % count, t_s)
        assert found.found == ""


def test_second_sequence_of_a_vehicles_state() -> None:
    found = second()
    for _ in range(9):
        found.second_frame(1.0, are_two=False)
    assert found.found == ""
    found.second_frame(1.0, are_two=True)
    assert found.found == "two sequences of frames interleave"
    for uid in (7, 8):
        found.version(version(uid), 1.1)
    assert found.found.startswith("two sequences of frames interleave, and AUTOPILOT_VERSION comes")


def test_positions_that_are_not_newer_count_for_two_seconds() -> None:
    """A tenth of the positions each second, and two clock steps at most: never enough of either."""
    found = second()
    for tick in range(2000):
        t_s = 10.0 + tick / 100.0
        late_ms = 15 if tick % 10 == 0 else 0
        late_ms = 1500 if tick % 150 == 0 else late_ms
        found.position(position(round(t_s * 1e3) - late_ms, tick * 1e-3), t_s)
    assert found.found == ""
