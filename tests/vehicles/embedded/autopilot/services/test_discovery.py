"""What ground stations ask for when they connect."""

import asyncio
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.embedded.autopilot.services.test_missions import BOTH
from wil_campaign.vehicles.embedded.autopilot.services import discovery
from wil_campaign.vehicles.mavlink.framing import FrameSplitter

Scenario = Callable[[Any], Any]
MODES, MODE = discovery.AVAILABLE_MODES, discovery.CURRENT_MODE


def modes_in(raw: bytes, message_id: int) -> list[bytes]:
    return [each.payload for each in FrameSplitter().feed(raw) if each.message_id == message_id]


@BOTH
def test_modes_are_listed(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(5.0)
            assert await r.command(512, MODES, 0) == 0
            listed = modes_in(bytes(r.raw), MODES)
            assert len(listed) == listed[0][8] == (11 if autopilot == "px4" else 10)
            assert await r.command(512, MODES, 2) == 0
            assert modes_in(bytes(r.raw), MODES)[-1] == listed[1]
            refused = mavlink.MAV_RESULT_DENIED if autopilot == "px4" else mavlink.MAV_RESULT_FAILED
            assert await r.command(512, MODES, 99) == refused
            assert await r.command(512, MODE) == 0
            (current,) = modes_in(bytes(r.raw), MODE)
            assert int.from_bytes(current[:4].ljust(4, b"\0"), "little") == r.custom_mode

    virtually(scenario())


@BOTH
def test_files_are_refused_at_once(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(1.0)
            # ResetSessions, ListDirectory, OpenFileRO, ReadFile, and one that is none.
            answers = {2: None, 3: 6, 4: 10, 5: 4, 99: 7}
            for seq, (opcode, error) in enumerate(answers.items()):
                payload = [seq, 0, 0, opcode, 5, 0, 0, 0, 0, 0, 0, 0, *b"@PARA"]
                payload += [0] * (251 - len(payload))
                r.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
                await asyncio.sleep(0.05)
                answer = r.last["FILE_TRANSFER_PROTOCOL"]
                assert answer.payload[0] == seq + 1
                assert answer.payload[5] == opcode
                said = (answer.payload[3], answer.payload[12])
                assert said == ((128, 0) if error is None else (129, error))

    virtually(scenario())


@BOTH
def test_the_time_of_day_is_taken(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(2.0)
            for wrong in (5, 2**64 - 1):
                r.send(mavlink.MAVLink_system_time_message(wrong, 0))
                await r.command(512, 2)
                assert r.last["SYSTEM_TIME"].time_unix_usec == 0
            noon_us = 1_790_000_000_000_000
            r.send(mavlink.MAVLink_system_time_message(noon_us, 0))
            await asyncio.sleep(3.0)
            await r.command(512, 2)
            assert abs(r.last["SYSTEM_TIME"].time_unix_usec - noon_us - 3_000_000) < 100_000

    virtually(scenario())


def test_px4_says_which_parameter_it_does_not_have(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            await asyncio.sleep(1.0)
            r.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
            await asyncio.sleep(0.05)
            error = r.last["PARAM_ERROR"]
            unknown = mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
            assert (error.param_id, error.error) == ("NO_SUCH", unknown)
            r.send(mavlink.MAVLink_param_set_message(1, 1, b"NO_SUCH_ONE", 1.0, 9))
            await asyncio.sleep(0.05)
            assert r.last["PARAM_ERROR"].param_id == "NO_SUCH_ONE"

    virtually(scenario())


@BOTH
def test_impossible_homes_are_refused(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(25.0)
            denied, px4 = mavlink.MAV_RESULT_DENIED, autopilot == "px4"
            off_globe = denied if px4 else mavlink.MAV_RESULT_FAILED
            assert await r.command(179, 0, 0, 0, 0, 473977420.0, 85455940.0, 490.0) == off_globe
            assert await r.command(179, 0, 0, 0, 0, 47.4, 8.55, 3e6) == denied
            no_mode = await r.command(176, float("nan"), float("nan"), float("nan"))
            assert no_mode == (0 if px4 else denied)
            assert await r.command(510, 1e9) == denied
            assert await r.command(512, float("nan")) == 0
            assert await r.command(410) == 0
            assert abs(r.last["HOME_POSITION"].altitude - 488_000) < 2000

    virtually(scenario())


@BOTH
def test_px4_tells_its_mode_every_two_seconds_and_arducopter_when_asked(
    rig: Any, virtually: Scenario, autopilot: str
) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot, full_streams=True) as r:
            await asyncio.sleep(9.0)
            assert len(modes_in(bytes(r.raw), MODE)) == (5 if autopilot == "px4" else 0)
            assert await r.command(512, MODE) == 0
            assert len(modes_in(bytes(r.raw), MODE)) == (6 if autopilot == "px4" else 1)

    virtually(scenario())


@BOTH
def test_the_ground_truth_comes_on_request_alone(
    rig: Any, virtually: Scenario, autopilot: str
) -> None:
    kind, number = ("HIL_STATE_QUATERNION", 115) if autopilot == "px4" else ("SIM_STATE", 108)

    async def scenario() -> None:
        async with rig(autopilot=autopilot, full_streams=True) as r:
            await asyncio.sleep(3.0)
            assert not r.of(kind)
            assert await r.command(512, number) == 0
            (truth,) = r.of(kind)
            assert getattr(truth, "time_usec", 0) == 0

    virtually(scenario())
