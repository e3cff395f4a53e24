"""Commands and parameters against a scripted peer: lost, refused, slow, of every type."""

import asyncio
import gc
import struct
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget, command_long
from wil_campaign.vehicles.driver.onboard.mission_protocol import (
    ItemList,
    MissionError,
    MissionItem,
    MissionProtocol,
)
from wil_campaign.vehicles.driver.onboard.parameters import (
    OnboardParameters,
    decode_parameter,
    encode_parameter,
)
from wil_campaign.vehicles.driver.session.commands import Commander
from wil_campaign.vehicles.driver.session.conditions import ConditionWaiter
from wil_campaign.vehicles.driver.session.repeater import Repeater
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.errors import (
    CommandError,
    CommandTimeoutError,
    ParameterError,
    VehicleError,
)

PEER = MavlinkTarget(1, 1)
TAKEOFF = mavlink.MAV_CMD_NAV_TAKEOFF


def _run(
    fake_pair: Callable[..., Any],
    script: Callable[[Any, MavlinkSession], Awaitable[Any]],
    prepare: Callable[[Any], None] = lambda _: None,
) -> tuple[Any, Any]:
    """Run a script against the peer; return its result and the peer."""

    async def fly() -> tuple[Any, Any]:
        link, peer = fake_pair()
        session = MavlinkSession(link=link, own=MavlinkTarget(245, 190))
        session.target = PEER
        prepare(peer)
        async with peer, link:
            return await script(peer, session), peer

    return run_virtual(fly())


def _commander(session: MavlinkSession) -> Commander:
    return Commander(
        session=session, circumstances=lambda: "; its last STATUSTEXT: Crash: Disarming"
    )


def test_an_accepted_command_is_sent_once(fake_pair: Callable[..., Any]) -> None:
    async def script(peer: Any, session: MavlinkSession) -> None:
        await _commander(session).run(command_long(PEER, TAKEOFF, 0.0))

    _, peer = _run(fake_pair, script)
    assert [each.confirmation for each in peer.commands(TAKEOFF)] == [0]


def test_lost_acks_are_asked_for_again_with_confirmation(fake_pair: Callable[..., Any]) -> None:
    def prepare(peer: Any) -> None:
        peer.replies[f"COMMAND_LONG:{TAKEOFF}"] = lambda peer, message: (
            peer.ack(message) if message.confirmation == 2 else None
        )

    async def script(peer: Any, session: MavlinkSession) -> float:
        await _commander(session).run(command_long(PEER, TAKEOFF, 0.0))
        return asyncio.get_running_loop().time()

    took_s, peer = _run(fake_pair, script, prepare)
    assert [each.confirmation for each in peer.commands(TAKEOFF)] == [0, 1, 2]
    assert took_s == pytest.approx(1.01)


def test_awaited_commands_of_a_closed_commander_fail(fake_pair: Callable[..., Any]) -> None:
    """A CancelledError would end a task silently, although nobody cancelled it."""
    reported: list[Any] = []

    def prepare(peer: Any) -> None:
        for number in (TAKEOFF, mavlink.MAV_CMD_DO_SET_MODE):
            peer.replies[f"COMMAND_LONG:{number}"] = lambda peer, message: None

    async def script(_: Any, session: MavlinkSession) -> list[Any]:
        asyncio.get_running_loop().set_exception_handler(lambda _, what: reported.append(what))
        commander = _commander(session)
        commander.begin(command_long(PEER, mavlink.MAV_CMD_DO_SET_MODE))
        run = partial(commander.run, command_long(PEER, TAKEOFF, 0.0))

        async def close_while_it_runs() -> None:
            async with asyncio.TaskGroup() as group:
                group.create_task(run())
                await asyncio.sleep(0.2)
                commander.close()

        with pytest.raises(ExceptionGroup) as errors:
            await close_while_it_runs()
        later = await asyncio.gather(run(), return_exceptions=True)
        gc.collect()
        return [*errors.value.exceptions, *later]

    errors, peer = _run(fake_pair, script, prepare)
    assert [type(error) for error in errors] == [VehicleError, VehicleError]
    assert str(errors[0]) == (
        "memory:a: the connection was closed; a command without an acknowledgement may have been "
        "executed all the same"
    )
    assert len(peer.commands(TAKEOFF)) == 1
    assert reported == []


def test_a_list_that_is_accepted_before_its_items_is_an_error(
    fake_pair: Callable[..., Any],
) -> None:
    def accept(peer: Any, message: Any) -> None:
        peer.say(mavlink.MAVLink_mission_ack_message(245, 190, 0, message.mission_type))

    def prepare(peer: Any) -> None:
        peer.replies["MISSION_COUNT"] = accept

    async def script(peer: Any, session: MavlinkSession) -> None:
        item = MissionItem(command=mavlink.MAV_CMD_NAV_WAYPOINT)
        async with asyncio.timeout(60.0):
            await MissionProtocol(session=session).upload(ItemList.MISSION, [item])

    with pytest.raises(MissionError, match="mission: it was accepted after 0 of 1 items"):
        _run(fake_pair, script, prepare)


@pytest.mark.parametrize("number", [0, 1, 9])
def test_a_list_whose_items_are_requested_for_ever_is_an_error(
    fake_pair: Callable[..., Any], number: int
) -> None:
    """Also after a flight, where no watchdog ends the restoration of a fence."""

    def request(peer: Any, message: Any) -> None:
        request = mavlink.MAVLink_mission_request_int_message(245, 190, number, 0)
        asyncio.get_running_loop().call_later(0.05, peer.say, request)

    def prepare(peer: Any) -> None:
        peer.replies["MISSION_COUNT"] = peer.replies["MISSION_ITEM_INT"] = request

    async def script(peer: Any, session: MavlinkSession) -> None:
        item = MissionItem(command=mavlink.MAV_CMD_NAV_WAYPOINT)
        async with asyncio.timeout(60.0):
            await MissionProtocol(session=session).upload(ItemList.MISSION, [item] * 3)

    with pytest.raises(MissionError, match="MISSION_REQUEST_INT comes again and again"):
        _run(fake_pair, script, prepare)


@pytest.mark.parametrize("what", ["download", "upload", "clear"])
def test_a_transfer_that_fails_is_ended_on_the_vehicle_too(
    fake_pair: Callable[..., Any], what: str
) -> None:
    """PX4 is busy with it for 5 s otherwise, and refuses the restoration of the fence."""

    async def script(peer: Any, session: MavlinkSession) -> None:
        missions = MissionProtocol(session=session)
        item = MissionItem(command=mavlink.MAV_CMD_NAV_WAYPOINT)
        given = ([item],) if what == "upload" else ()
        with pytest.raises(MissionError):
            await getattr(missions, what)(ItemList.FENCE, *given)
        await asyncio.sleep(0.1)
        last = peer.received[-3:]
        assert {(one.get_type(), one.type) for one in last} == {
            ("MISSION_ACK", mavlink.MAV_MISSION_OPERATION_CANCELLED)
        }
        assert {one.mission_type for one in last} == set(ItemList)

    _run(fake_pair, script)


def test_a_command_that_is_in_progress_for_ever_is_an_error(fake_pair: Callable[..., Any]) -> None:
    def go_on(peer: Any, message: Any) -> None:
        peer.ack(message, mavlink.MAV_RESULT_IN_PROGRESS)
        asyncio.get_running_loop().call_later(1.0, go_on, peer, message)

    def prepare(peer: Any) -> None:
        peer.replies[f"COMMAND_LONG:{TAKEOFF}"] = go_on

    async def script(peer: Any, session: MavlinkSession) -> float:
        with pytest.raises(CommandError, match="does not end: MAV_RESULT_IN_PROGRESS"):
            async with asyncio.timeout(300.0):
                await _commander(session).run(command_long(PEER, TAKEOFF, 0.0))
        return asyncio.get_running_loop().time()

    ended_s, _ = _run(fake_pair, script, prepare)
    assert 60.0 <= ended_s < 62.0


def test_no_answer_is_an_error_with_names(fake_pair: Callable[..., Any]) -> None:
    def prepare(peer: Any) -> None:
        peer.replies[f"COMMAND_LONG:{TAKEOFF}"] = lambda peer, message: None

    async def script(peer: Any, session: MavlinkSession) -> None:
        await _commander(session).run(command_long(PEER, TAKEOFF, 0.0))

    with pytest.raises(CommandTimeoutError, match="TAKEOFF was not acknowledged") as caught:
        _run(fake_pair, script, prepare)
    assert "Crash: Disarming" in str(caught.value)
    assert caught.value.result == "none"


def test_refusal_is_an_error_with_names(fake_pair: Callable[..., Any]) -> None:
    def prepare(peer: Any) -> None:
        peer.replies[f"COMMAND_LONG:{TAKEOFF}"] = lambda peer, message: peer.ack(message, 2)

    async def script(peer: Any, session: MavlinkSession) -> None:
        await _commander(session).run(command_long(PEER, TAKEOFF, 0.0))

    with pytest.raises(CommandError, match="refused with MAV_RESULT_DENIED") as caught:
        _run(fake_pair, script, prepare)
    assert caught.value.command == "MAV_CMD_NAV_TAKEOFF"


def test_refusal_of_a_repetition_is_no_error_when_it_is_done(fake_pair: Callable[..., Any]) -> None:
    def prepare(peer: Any) -> None:
        peer.replies[f"COMMAND_LONG:{TAKEOFF}"] = lambda peer, message: (
            peer.ack(message, 4) if message.confirmation else None
        )

    async def script(peer: Any, session: MavlinkSession) -> list[str]:
        results = []
        for done in (True, False):
            try:
                await _commander(session).run(
                    command_long(PEER, TAKEOFF, 0.0), done_anyway=partial(bool, done)
                )
                results.append("fine")
            except CommandError as error:
                results.append(error.result)
        return results

    assert _run(fake_pair, script, prepare)[0] == ["fine", "MAV_RESULT_FAILED"]


def test_progress_gives_time(fake_pair: Callable[..., Any]) -> None:
    def reply(peer: Any, message: Any) -> None:
        peer.ack(message, 5)
        asyncio.get_running_loop().call_later(7.0, peer.ack, message)

    def prepare(peer: Any) -> None:
        peer.replies[f"COMMAND_LONG:{TAKEOFF}"] = reply

    async def script(peer: Any, session: MavlinkSession) -> float:
        await _commander(session).run(command_long(PEER, TAKEOFF, 0.0))
        return asyncio.get_running_loop().time()

    took_s, peer = _run(fake_pair, script, prepare)
    assert took_s > 7.0
    assert len(peer.commands(TAKEOFF)) == 1


def test_a_temporary_rejection_is_tried_again(fake_pair: Callable[..., Any]) -> None:
    def prepare(peer: Any) -> None:
        peer.replies[f"COMMAND_LONG:{TAKEOFF}"] = lambda peer, message: peer.ack(
            message, 0 if message.confirmation == 1 else 1
        )

    async def script(peer: Any, session: MavlinkSession) -> None:
        await _commander(session).run(command_long(PEER, TAKEOFF, 0.0))

    assert len(_run(fake_pair, script, prepare)[1].commands(TAKEOFF)) == 2


@pytest.mark.parametrize("other", [(255, 190), (245, 191)])
def test_acks_for_others_do_not_count(
    fake_pair: Callable[..., Any], other: tuple[int, int]
) -> None:
    """A ground station's, and the guard's, which has our system id."""

    def prepare(peer: Any) -> None:
        peer.replies[f"COMMAND_LONG:{TAKEOFF}"] = lambda peer, message: peer.say(
            mavlink.MAVLink_command_ack_message(TAKEOFF, 0, 0, 0, *other)
        )

    async def script(peer: Any, session: MavlinkSession) -> None:
        await _commander(session).run(command_long(PEER, TAKEOFF, 0.0))

    with pytest.raises(CommandTimeoutError):
        _run(fake_pair, script, prepare)


def test_the_same_command_waits_its_turn_or_says_so(fake_pair: Callable[..., Any]) -> None:
    async def script(peer: Any, session: MavlinkSession) -> int:
        commander = _commander(session)
        first = commander.begin(command_long(PEER, TAKEOFF, 0.0))
        with pytest.raises(CommandError, match="not acknowledged yet"):
            commander.begin(command_long(PEER, TAKEOFF, 0.0))
        await first
        await asyncio.gather(*(commander.run(command_long(PEER, TAKEOFF, 0.0)) for _ in range(3)))
        return len(peer.commands(TAKEOFF))

    assert _run(fake_pair, script)[0] == 4


REAL, INT32, INT8, UINT16 = 9, 6, 2, 3


@pytest.mark.parametrize(
    ("kind", "value"), [(REAL, 2.5), (INT32, -2), (INT32, 121212), (INT8, -3), (UINT16, 65535)]
)
@pytest.mark.parametrize("bytewise", [True, False])
def test_parameters_are_set_and_read_back(
    fake_pair: Callable[..., Any], kind: int, value: float, bytewise: bool
) -> None:
    def prepare(peer: Any) -> None:
        peer.parameters["SOME_PARAM"] = (encode_parameter(1, kind, bytewise=bytewise), kind)

    async def script(peer: Any, session: MavlinkSession) -> Any:
        parameters = OnboardParameters(session=session)
        parameters.use_bytewise(bytewise)
        assert await parameters.get("SOME_PARAM") == 1
        await parameters.set("SOME_PARAM", value)
        return await parameters.get("SOME_PARAM")

    back, peer = _run(fake_pair, script, prepare)
    assert back == value
    assert isinstance(back, float if kind == REAL else int)
    if bytewise and kind == INT32:
        raw = struct.pack("<f", peer.parameters["SOME_PARAM"][0])
        assert struct.unpack("<i", raw)[0] == value


@given(st.integers(-(2**22), 2**31 - 2**24))
def test_whole_numbers_survive_as_bytes(value: int) -> None:
    # Beyond these, the bytes are a signalling NaN, which a float register may change.
    wire = encode_parameter(value, INT32, bytewise=True)
    assert (
        decode_parameter(struct.unpack("<f", struct.pack("<f", wire))[0], INT32, bytewise=True)
        == value
    )


@pytest.mark.parametrize("value", [-8_388_607, 2_139_095_041])
def test_a_whole_number_whose_bytes_a_float_would_change_is_refused(value: int) -> None:
    (as_float,) = struct.unpack("<f", struct.pack("<i", value))
    if struct.pack("<f", as_float) == struct.pack("<i", value):  # Python 3.14 keeps them
        wire = encode_parameter(value, INT32, bytewise=True)
        assert decode_parameter(wire, INT32, bytewise=True) == value
    else:
        with pytest.raises(ParameterError, match="its bytes are those of a signalling NaN"):
            encode_parameter(value, INT32, bytewise=True)
    assert encode_parameter(value, INT32, bytewise=False) == value


@pytest.mark.parametrize(
    ("kind", "value", "words"),
    [(INT8, 300, "does not fit"), (INT32, 1.5, "not a whole number"), (UINT16, -1, "does not fit")],
)
def test_values_that_do_not_fit_are_refused(
    fake_pair: Callable[..., Any], kind: int, value: float, words: str
) -> None:
    def prepare(peer: Any) -> None:
        peer.parameters["SOME_PARAM"] = (1.0, kind)

    async def script(peer: Any, session: MavlinkSession) -> None:
        await OnboardParameters(session=session).set("SOME_PARAM", value)

    with pytest.raises(ParameterError, match=f"SOME_PARAM.*{words}"):
        _run(fake_pair, script, prepare)


def test_a_parameter_that_stays_as_it_was_is_an_error(fake_pair: Callable[..., Any]) -> None:
    def prepare(peer: Any) -> None:
        peer.parameters["READ_ONLY"] = (1.0, REAL)
        peer.replies["PARAM_SET"] = lambda peer, message: peer.say(
            mavlink.MAVLink_param_value_message(b"READ_ONLY", 1.0, REAL, 1, 0)
        )

    async def script(peer: Any, session: MavlinkSession) -> None:
        await OnboardParameters(session=session).set("READ_ONLY", 3.0)

    with pytest.raises(ParameterError, match="READ_ONLY was set to"):
        _run(fake_pair, script, prepare)


def test_unknown_parameters_are_an_error_soon(fake_pair: Callable[..., Any]) -> None:
    async def script(peer: Any, session: MavlinkSession) -> None:
        await OnboardParameters(session=session).get("NO_SUCH_PARAM")

    unsent = "no reply for parameter NO_SUCH_PARAM.* received .* no parameter yet: .* arrive"
    with pytest.raises(ParameterError, match=unsent):
        _run(fake_pair, script)

    def prepare(peer: Any) -> None:
        peer.replies["PARAM_REQUEST_READ"] = lambda peer, message: peer.say(
            mavlink.MAVLink_param_error_message(245, 190, b"NO_SUCH_PARAM", -1, 1)
        )

    with pytest.raises(ParameterError, match="DOES_NOT_EXIST"):
        _run(fake_pair, script, prepare)


def test_a_parameter_without_an_answer_says_what_else_the_vehicle_sent(
    fake_pair: Callable[..., Any],
) -> None:
    def prepare(peer: Any) -> None:
        peer.parameters["SOME_PARAM"] = (1.0, REAL)

    async def known(peer: Any, session: MavlinkSession) -> None:
        parameters = OnboardParameters(session=session)
        await parameters.get("SOME_PARAM")
        await parameters.get("NO_SUCH_PARAM")

    async def silent(peer: Any, session: MavlinkSession) -> None:
        parameters = OnboardParameters(session=session)
        await parameters.get("SOME_PARAM")
        peer.muted = True
        await parameters.get("SOME_PARAM")

    async def lossy(peer: Any, session: MavlinkSession) -> None:
        parameters = OnboardParameters(session=session)
        await parameters.get("SOME_PARAM")
        peer.replies["PARAM_SET"] = lambda peer, message: None
        await parameters.set("SOME_PARAM", 2.0)

    with pytest.raises(ParameterError, match="answered for it before: the link loses messages"):
        _run(fake_pair, lossy, prepare)
    with pytest.raises(ParameterError, match="answered for other parameters: most likely this"):
        _run(fake_pair, known, prepare)
    with pytest.raises(ParameterError, match="nothing else was received from the vehicle"):
        _run(fake_pair, silent, prepare)


def test_a_repeater_keeps_its_grid() -> None:
    async def tick() -> list[float]:
        loop = asyncio.get_running_loop()
        times: list[float] = []
        await asyncio.sleep(0.35)
        repeater = Repeater(period_s=0.1, action=lambda: times.append(loop.time()))
        repeater.start()
        repeater.start()
        await asyncio.sleep(0.55)
        repeater.stop()
        assert not repeater.running
        await asyncio.sleep(1.0)
        return times

    assert run_virtual(tick()) == pytest.approx([0.35, 0.45, 0.55, 0.65, 0.75, 0.85])


def test_a_repeater_may_begin_after_a_period() -> None:
    async def tick() -> list[float]:
        loop = asyncio.get_running_loop()
        times: list[float] = []
        repeater = Repeater(period_s=0.1, action=lambda: times.append(loop.time()))
        repeater.start(at_once=False)
        await asyncio.sleep(0.35)
        repeater.stop()
        return times

    assert run_virtual(tick()) == pytest.approx([0.1, 0.2, 0.3])


def test_changes_wake_waiters_and_waits_time_out() -> None:
    async def wait() -> tuple[bool, bool, float]:
        changes, box = ConditionWaiter(), [0]
        loop = asyncio.get_running_loop()

        def put() -> None:
            box[0] = 1
            changes.notify()

        loop.call_later(1.0, put)
        came = await changes.until(lambda: box[0] == 1, 5.0)
        never = await changes.until(lambda: box[0] == 2, 0.5)
        return came, never, loop.time()

    assert run_virtual(wait()) == (True, False, 1.5)
