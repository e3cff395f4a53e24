"""The driver against a peer that misbehaves: every wait ends, and the error says why."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.ports import free_port
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.vehicle_state import BatteryState, EstimateSample, VehicleEvent
from wil_campaign.vehicles.errors import (
    AnchorError,
    ArmRefusedError,
    CommandTimeoutError,
    IdentifyError,
    NotReadyError,
    StateTimeoutError,
    VehicleError,
)
from wil_campaign.vehicles.links.link import Receiver
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.links.tapped import TappedLink
from wil_campaign.vehicles.links.udp import UdpLink
from wil_campaign.vehicles.poses.anchor import Anchor
from wil_campaign.vehicles.poses.headings import HeadingDifference
from wil_campaign.vehicles.setpoints import PositionSetpoint, VelocitySetpoint
from wil_campaign.worlds.frames import Pose

Script = Callable[[Driver, Any], Awaitable[Any]]


def _run(
    fake_pair: Callable[..., Any],
    script: Script,
    *,
    peer_is: str = "ardupilot",
    prepare: Callable[[Any], None] = lambda _: None,
    **options: Any,
) -> Any:
    async def fly() -> Any:
        link, peer = fake_pair(peer_is)
        prepare(peer)
        async with peer, Driver(name="real", link=link, **options) as driver:
            return await script(driver, peer)

    return run_virtual(fly())


async def _armed(driver: Driver) -> None:
    await driver.identify(5.0)
    await driver.ready(10.0)
    await driver.arm()


def test_identity_is_returned(fake_pair: Callable[..., Any]) -> None:
    async def script(driver: Driver, peer: Any) -> Any:
        with pytest.raises(VehicleError, match="identify"):
            driver.identity  # noqa: B018 - asking is the test
        identity = await driver.identify(5.0)
        assert driver.identity is identity
        assert len(peer.of_type("HEARTBEAT")) >= 1
        assert peer.of_type("HEARTBEAT")[0].type == mavlink.MAV_TYPE_GCS
        return identity

    identity = _run(fake_pair, script, peer_is="px4")
    assert (identity.autopilot, identity.system_id) == ("px4", 1)
    assert (identity.version_text, identity.vehicle_type) == ("1.18.0-beta", "quadrotor")
    assert identity.uid == f"{77:016x}"


def _become(**fields: Any) -> Callable[[Any], None]:
    def prepare(peer: Any) -> None:
        for name, value in fields.items():
            setattr(peer, name, value)

    return prepare


@pytest.mark.parametrize(
    ("fields", "wanted", "words"),
    [
        ({}, "px4", "system 1 component 1 is ardupilot, and px4 was requested"),
        ({"vehicle_type": 6, "autopilot": 8}, "auto", "this is a ground station's port"),
        ({"autopilot": 4}, "auto", "which is not PX4 or ArduCopter"),
        ({"vehicle_type": 1}, "auto", "only multicopters are supported"),
        ({"muted": True}, "auto", "nothing arrived"),
    ],
)
def test_when_nothing_fits_it_says_what_was_received(
    fake_pair: Callable[..., Any], fields: dict[str, Any], wanted: Any, words: str
) -> None:
    async def script(driver: Driver, peer: Any) -> float:
        with pytest.raises(IdentifyError, match=words) as caught:
            await driver.identify(4.0)
        assert "memory:a" in str(caught.value)
        return asyncio.get_running_loop().time()

    ended_s = _run(fake_pair, script, prepare=_become(**fields), autopilot=wanted)
    assert ended_s == pytest.approx(4.0)


def test_garbage_and_headless_mavlink_are_distinguished() -> None:
    async def listen(data: bytes) -> str:
        ours, theirs = memory_pair()
        async with theirs, Driver(name="real", link=ours) as driver:
            for _ in range(20):
                theirs.write(data)
            with pytest.raises(IdentifyError) as caught:
                await driver.identify(2.0)
            return str(caught.value)

    assert "not MAVLink" in run_virtual(listen(b"\x00\x55garbage"))
    from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

    codec = MavlinkCodec(system_id=1, component_id=1)
    attitude = codec.pack(mavlink.MAVLink_attitude_message(1, *[0.0] * 6))
    assert "no heartbeat" in run_virtual(listen(attitude))


def test_a_one_way_link_is_reported(fake_pair: Callable[..., Any]) -> None:
    def prepare(peer: Any) -> None:
        peer.replies["COMMAND_LONG:512"] = lambda peer, message: None

    async def script(driver: Driver, peer: Any) -> None:
        with pytest.raises(IdentifyError, match="does not answer"):
            await driver.identify(3.0)
        # Once the way back works, the same driver finds it.
        del peer.replies["COMMAND_LONG:512"]
        identity = await driver.identify(3.0)
        assert await driver.identify(3.0) is identity

    _run(fake_pair, script, prepare=prepare)


@pytest.mark.parametrize(("late_s", "words"), [(0.1, "one-way"), (1.2, "itself was 1.2 s late")])
def test_a_link_is_not_blamed_for_frames_that_this_program_read_late(
    late_s: float, words: str
) -> None:
    from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

    class ReadLate(TappedLink):
        """A link whose bytes were stamped when they came, and are read so much later."""

        def receive(self, receiver: Receiver) -> None:
            super().receive(lambda data, t_s: receiver(data, t_s - late_s))

    async def listen() -> str:
        ours, theirs = memory_pair()
        codec = MavlinkCodec(system_id=1, component_id=1)
        heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 1, 0, 3, 3)

        async def beat() -> None:
            while True:
                theirs.write(codec.pack(heartbeat))
                await asyncio.sleep(0.5)

        async with theirs, Driver(name="real", link=ReadLate(ours)) as driver:
            beating = asyncio.create_task(beat(), name="heartbeats")
            with pytest.raises(IdentifyError) as caught:
                await driver.identify(3.0)
            beating.cancel()
            return str(caught.value)

    said = run_virtual(listen())
    assert "sends heartbeats but does not answer our requests" in said
    assert words in said
    assert ("link" in said) == (late_s < 0.5)


async def test_a_closed_udp_port_is_reported() -> None:
    link = UdpLink(address=parse_link(f"udpout://127.0.0.1:{free_port()}"))
    async with Driver(name="real", link=link) as driver:
        with pytest.raises(IdentifyError, match=r"(?i)nothing arrived .*refused"):
            await driver.identify(0.3)


def test_never_ready_says_why(fake_pair: Callable[..., Any]) -> None:
    def prepare(peer: Any) -> None:
        peer.prearm = False
        peer.flags = 167
        peer.replies["COMMAND_LONG:401"] = lambda peer, message: peer.text("PreArm: Need Position")

    async def script(driver: Driver, peer: Any) -> float:
        await driver.identify(5.0)
        began_s = asyncio.get_running_loop().time()
        with pytest.raises(NotReadyError) as caught:
            await driver.ready(7.0)
        error = caught.value
        assert "pre-arm checks have not passed" in error.reasons
        assert "Need Position" in error.reasons
        assert "PreArm: Need Position" in error.texts
        assert "no horizontal position" in str(error)
        return asyncio.get_running_loop().time() - began_s

    assert 7.0 <= _run(fake_pair, script, prepare=prepare) < 7.1


def test_a_vehicle_that_somebody_else_has_armed_is_not_ready(fake_pair: Callable[..., Any]) -> None:
    async def script(driver: Driver, peer: Any) -> float:
        peer.armed = True
        await driver.identify(5.0)
        with pytest.raises(NotReadyError, match="armed already, by somebody else; land and disarm"):
            await driver.ready(7.0)
        asyncio.get_running_loop().call_later(10.0, setattr, peer, "armed", False)
        began_s = asyncio.get_running_loop().time()
        await driver.ready(60.0)
        ready_s = asyncio.get_running_loop().time() - began_s
        peer.armed = True
        peer.heartbeat()
        await asyncio.sleep(0.1)
        with pytest.raises(VehicleError, match="armed already, by somebody else; land and disarm"):
            await driver.arm()
        assert peer.commands(400) == []
        peer.armed = False
        peer.heartbeat()
        await asyncio.sleep(0.1)
        await driver.arm()
        await driver.ready(5.0)
        return ready_s

    assert 10.0 < _run(fake_pair, script) < 11.5


def test_becomes_ready_late(fake_pair: Callable[..., Any]) -> None:
    async def script(driver: Driver, peer: Any) -> float:
        await driver.identify(5.0)
        asyncio.get_running_loop().call_at(20.0, setattr, peer, "flags", 831)
        await driver.ready(60.0)
        return asyncio.get_running_loop().time()

    ready_s = _run(fake_pair, script, prepare=_become(flags=167))
    assert 20.0 < ready_s < 21.0


def test_streams_that_do_not_come_are_asked_for_again(fake_pair: Callable[..., Any]) -> None:
    async def script(driver: Driver, peer: Any) -> list[int]:
        await driver.identify(5.0)
        with pytest.raises(NotReadyError, match="ATTITUDE_QUATERNION does not arrive"):
            await driver.ready(5.0)
        return [int(each.param1) for each in peer.commands(511)]

    def prepare(peer: Any) -> None:
        peer.says_quaternions = False

    asked = _run(fake_pair, script, prepare=prepare)
    assert asked.count(31) == 3
    assert asked.count(32) == 1


def test_arming_refused_says_the_reason(fake_pair: Callable[..., Any]) -> None:
    def refuse(peer: Any, message: Any) -> None:
        peer.ack(message, mavlink.MAV_RESULT_FAILED)
        asyncio.get_running_loop().call_later(0.1, peer.text, "Arm: Throttle too high")

    def prepare(peer: Any) -> None:
        peer.replies["COMMAND_LONG:400"] = refuse

    async def script(driver: Driver, peer: Any) -> None:
        with pytest.raises(ArmRefusedError, match="Throttle too high") as caught:
            await _armed(driver)
        assert caught.value.reasons == ("Throttle too high",)
        assert caught.value.result == "MAV_RESULT_FAILED"

    _run(fake_pair, script, prepare=prepare)


def test_accepted_but_not_armed_is_an_error(fake_pair: Callable[..., Any]) -> None:
    def prepare(peer: Any) -> None:
        peer.replies["COMMAND_LONG:400"] = lambda peer, message: peer.ack(message)

    async def script(driver: Driver, peer: Any) -> None:
        with pytest.raises(StateTimeoutError, match="not armed within 3 s"):
            await _armed(driver)

    _run(fake_pair, script, prepare=prepare)


def test_a_vehicle_that_moves_is_not_anchored(fake_pair: Callable[..., Any]) -> None:
    async def script(driver: Driver, peer: Any) -> None:
        await driver.identify(5.0)
        with pytest.raises(AnchorError, match="real: not anchored"):
            driver.send(VelocitySetpoint((0.0, 0.0, 0.0)))
        await driver.ready(10.0)
        peer.position_ned_m = (5.0, 0.0, 0.0)
        await asyncio.sleep(0.5)
        with pytest.raises(AnchorError, match=r"real: .*moved by 5\.00 m"):
            await driver.arm()

    _run(fake_pair, script)


def test_silence_is_an_event_and_in_the_error(fake_pair: Callable[..., Any]) -> None:
    async def script(driver: Driver, peer: Any) -> list[VehicleEvent]:
        events: list[VehicleEvent] = []
        await _armed(driver)
        driver.on_event(events.append)
        await asyncio.sleep(1.0)
        peer.muted = True
        quiet_s = asyncio.get_running_loop().time()
        await asyncio.sleep(2.0)
        assert not driver.state.link_up
        assert [each.kind for each in events] == ["link_lost"]
        assert events[0].t_s == pytest.approx(quiet_s + 1.5, abs=0.15)
        with pytest.raises(CommandTimeoutError, match="nothing received for 6"):
            await driver.hold()
        with pytest.raises(StateTimeoutError, match="nothing received for"):
            await driver.disarmed(5.0)
        peer.muted = False
        await asyncio.sleep(0.5)
        assert driver.state.link_up
        return events

    events = _run(fake_pair, script)
    assert [each.kind for each in events] == ["link_lost", "link_back"]
    assert events[1].duration_s == pytest.approx(11.0, abs=0.1)


def test_a_refusal_to_disarm_on_the_ground_is_not_the_last_word(
    fake_pair: Callable[..., Any],
) -> None:
    """As of an ArduPilot with DISARM_DELAY of 0, whose landing detector is slow."""

    def refuse_twice(peer: Any, message: Any) -> None:
        refused = len(peer.commands(400)) < 4  # The first one armed it.
        peer.armed = bool(message.param1) or refused
        peer.ack(message, mavlink.MAV_RESULT_FAILED if refused and not message.param1 else 0)
        peer.heartbeat()

    async def script(driver: Driver, peer: Any) -> float:
        peer.replies["COMMAND_LONG:400"] = refuse_twice
        await _armed(driver)
        began_s = asyncio.get_running_loop().time()
        await driver.disarmed(60.0)
        return asyncio.get_running_loop().time() - began_s

    assert 15.0 <= _run(fake_pair, script) < 18.0


def test_a_vehicle_is_not_commanded_to_disarm_before_it_has_landed(
    fake_pair: Callable[..., Any],
) -> None:
    async def script(driver: Driver, peer: Any) -> None:
        await _armed(driver)
        peer.landed_state = 4
        with pytest.raises(StateTimeoutError, match="not disarmed within 20 s"):
            await driver.disarmed(20.0)
        assert [each.param1 for each in peer.commands(400)] == [1.0]

    _run(fake_pair, script)


@pytest.mark.parametrize(
    ("voltage_mv", "percent", "battery"),
    [
        (12_600, 80, BatteryState(12.6, 0.8)),
        (14_200, 80, BatteryState(14.2, 0.8)),
        (9_000, 0, BatteryState(9.0, 0.0)),
        (0, -1, BatteryState(None, None)),
        (0, 0, BatteryState(None, None)),
        (0, 100, BatteryState(None, 1.0)),
        (0xFFFF, -1, BatteryState(None, None)),
        (0xFFFF, 0, BatteryState(None, 0.0)),
    ],
)
def test_a_battery_without_a_power_module_is_not_measured(
    fake_pair: Callable[..., Any], voltage_mv: int, percent: int, battery: BatteryState
) -> None:
    """Nor does it count as a report of a battery, which the evidence of its oracle is."""

    async def script(driver: Driver, peer: Any) -> None:
        await driver.identify(5.0)
        peer.battery = voltage_mv, percent
        await asyncio.sleep(1.0)
        assert driver.state.battery == battery
        before_s = driver.reported_s.get("battery")
        await asyncio.sleep(2.0)
        reports = driver.reported_s.get("battery") != before_s
        assert reports == (battery != BatteryState(None, None))

    _run(fake_pair, script)


def test_events_tell_requested_changes_from_others(fake_pair: Callable[..., Any]) -> None:
    async def script(driver: Driver, peer: Any) -> list[tuple[str, str, bool]]:
        events: list[VehicleEvent] = []
        driver.on_event(events.append)
        await _armed(driver)
        await driver.hold()
        await driver.land()
        peer.custom_mode, peer.system_status = 6, 5
        peer.text("Radio Failsafe - Disarming", 2)
        peer.heartbeat()
        peer.flags = 1024
        peer.landed_state = 2
        await asyncio.sleep(1.0)
        assert driver.state.failsafe
        assert driver.state.faults
        assert driver.state.texts[-1].text == "Radio Failsafe - Disarming"
        peer.armed, peer.flags, peer.system_status = False, 831, 3
        await asyncio.sleep(1.5)
        return [(each.kind, each.text, each.asked) for each in events]

    fault = (
        "the estimator is not initialised, the estimator has lost its attitude, its horizontal "
        "velocity, its vertical velocity, its absolute height (ATTITUDE, VELOCITY_HORIZ, "
        "VELOCITY_VERT, POS_VERT_ABS), the estimator has lost its relative position, its absolute "
        "position (POS_HORIZ_REL, POS_HORIZ_ABS)"
    )
    assert _run(fake_pair, script) == [
        ("mode", "STABILIZE", False),
        ("landed_state", "on_ground", False),
        ("mode", "GUIDED", True),
        ("armed", "GUIDED", False),
        ("mode", "BRAKE", True),
        ("mode", "LAND", True),
        ("text", "Radio Failsafe - Disarming", False),
        ("mode", "RTL", False),
        ("failsafe", "MAV_STATE_CRITICAL", False),
        ("fault", fault, False),
        ("landed_state", "in_air", False),
        ("disarmed", "RTL", False),
        ("failsafe_over", "MAV_STATE_STANDBY", False),
        ("fault_over", fault, False),
    ]


def test_estimates_and_setpoints_are_in_the_world(fake_pair: Callable[..., Any]) -> None:
    start = Pose.of(10.0, 20.0, 0.0, yaw_rad=1.5707963267948966)

    async def script(driver: Driver, peer: Any) -> list[EstimateSample]:
        samples: list[EstimateSample] = []
        driver.on_estimate(samples.append)
        await _armed(driver)
        peer.position_ned_m = (101.0, 50.0, -2.0)
        await asyncio.sleep(0.5)
        driver.send(VelocitySetpoint((0.0, 1.0, 0.0), yaw_rate_rad_s=0.1))
        driver.send(PositionSetpoint((10.0, 25.0, -3.0), yaw_rad=1.5707963267948966))
        await asyncio.sleep(0.1)
        return [samples[0], samples[-1], *peer.of_type("SET_POSITION_TARGET_LOCAL_NED")]

    def prepare(peer: Any) -> None:
        peer.position_ned_m = (100.0, 50.0, 0.0)
        peer.boot_offset_s = 1000.0

    first, last, velocity, position = _run(fake_pair, script, prepare=prepare, start=start)
    assert first.pose.position_ned_m == pytest.approx((10.0, 20.0, 0.0))
    assert first.pose.yaw_rad == pytest.approx(1.5707963)
    # One metre north by the autopilot is one metre east in the world: it was turned by 90 deg.
    assert last.pose.position_ned_m == pytest.approx((10.0, 21.0, -2.0))
    assert (velocity.vx, velocity.vy) == pytest.approx((1.0, 0.0), abs=1e-6)
    assert velocity.yaw_rate == pytest.approx(0.1)
    assert (position.x, position.y, position.z) == pytest.approx((105.0, 50.0, -3.0), abs=1e-4)
    assert position.yaw == pytest.approx(0.0, abs=1e-6)
    # The memory link takes 5 ms; stamps are cut to whole milliseconds.
    assert last.arrived_s - last.t_s == pytest.approx(0.005, abs=0.0021)
    assert last.boot_s == pytest.approx(last.t_s + 1000.0, abs=0.0021)
    assert position.time_boot_ms / 1e3 == pytest.approx(last.boot_s, abs=0.2)


def test_an_anchor_that_is_given_is_kept(fake_pair: Callable[..., Any]) -> None:
    async def script(driver: Driver, peer: Any) -> Any:
        await driver.identify(5.0)
        driver.set_anchor(Anchor((1.0, 2.0, 3.0)))
        await driver.ready(10.0)
        await driver.arm()
        return driver.anchor

    assert _run(fake_pair, script) == Anchor((1.0, 2.0, 3.0))


def test_px4_stands_still_by_a_stream_until_somebody_flies(fake_pair: Callable[..., Any]) -> None:
    async def script(driver: Driver, peer: Any) -> None:
        await _armed(driver)
        before_s = asyncio.get_running_loop().time()
        await driver.enter_guided()
        assert asyncio.get_running_loop().time() - before_s >= 1.0
        await asyncio.sleep(1.0)
        stream = peer.of_type("SET_POSITION_TARGET_LOCAL_NED")
        assert len(stream) == pytest.approx(41, abs=2)
        assert all((each.vx, each.vy, each.vz) == (0.0, 0.0, 0.0) for each in stream)
        mode = next(each for each in peer.commands(176) if each.param2 == 6.0)
        assert peer.received.index(stream[15]) < peer.received.index(mode)
        driver.send(VelocitySetpoint((1.0, 0.0, 0.0)))
        await asyncio.sleep(1.0)
        assert len(peer.of_type("SET_POSITION_TARGET_LOCAL_NED")) == len(stream) + 1

    _run(fake_pair, script, peer_is="px4")


def test_takeoff_is_on_the_wire_before_it_is_awaited(fake_pair: Callable[..., Any]) -> None:
    async def script(driver: Driver, peer: Any) -> None:
        await _armed(driver)
        accepted = driver.begin_takeoff(1.5)
        sent_s = asyncio.get_running_loop().time()
        await asyncio.sleep(0.006)
        (command,) = peer.commands(22)
        assert command.param7 == pytest.approx(489.5)
        await accepted
        assert asyncio.get_running_loop().time() == pytest.approx(sent_s + 0.01)

    _run(fake_pair, script, peer_is="px4")


def test_a_takeoff_whose_ack_was_lost_succeeds(fake_pair: Callable[..., Any]) -> None:
    def reply(peer: Any, message: Any) -> None:
        if message.confirmation == 0:
            peer.landed_state = 3
        else:
            peer.ack(message, mavlink.MAV_RESULT_FAILED)

    def prepare(peer: Any) -> None:
        peer.replies["COMMAND_LONG:22"] = reply

    async def script(driver: Driver, peer: Any) -> None:
        await _armed(driver)
        await driver.begin_takeoff(1.5)

    _run(fake_pair, script, prepare=prepare)


def test_disarm_and_terminate_send_their_commands(fake_pair: Callable[..., Any]) -> None:
    async def script(driver: Driver, peer: Any) -> None:
        await _armed(driver)
        assert driver.state.armed
        await driver.disarm()
        assert not driver.state.armed
        await driver.terminate()
        assert peer.commands(185)[0].param1 == 1.0

    _run(fake_pair, script)


def test_a_reboot_in_flight_is_an_event_and_the_anchor_is_gone(
    fake_pair: Callable[..., Any],
) -> None:
    async def script(driver: Driver, peer: Any) -> list[str]:
        events: list[VehicleEvent] = []
        await _armed(driver)
        await asyncio.sleep(5.0)
        driver.on_event(events.append)
        peer.boot_offset_s = -asyncio.get_running_loop().time()
        await asyncio.sleep(2.0)
        assert driver.anchor is None
        assert driver.state.estimate is None
        peer.armed = False
        await driver.ready(5.0)
        assert driver.anchor is not None
        return [each.kind for each in events]

    assert "reboot" in _run(fake_pair, script)


def test_a_time_boot_ms_that_begins_anew_after_49_days_is_no_reboot(
    fake_pair: Callable[..., Any],
) -> None:
    async def script(driver: Driver, peer: Any) -> None:
        turns: list[HeadingDifference] = []
        events: list[VehicleEvent] = []
        driver.on_heading(turns.append)
        driver.on_event(events.append)
        await _armed(driver)
        await asyncio.sleep(30.0)
        assert peer.boot_s > 2**32 * 1e-3
        assert "reboot" not in [each.kind for each in events]
        estimate = driver.state.estimate
        assert estimate is not None
        assert estimate.arrived_s - estimate.t_s == pytest.approx(0.005, abs=0.0021)
        assert turns[-1].t_s == pytest.approx(estimate.arrived_s, abs=1.0)
        driver.send(PositionSetpoint((1.0, 0.0, -1.0), yaw_rad=0.0))
        await asyncio.sleep(0.1)
        (setpoint,) = peer.of_type("SET_POSITION_TARGET_LOCAL_NED")[-1:]
        since_s = peer.boot_s - 2**32 * 1e-3 - 0.1
        assert setpoint.time_boot_ms * 1e-3 == pytest.approx(since_s, abs=0.01)

    def prepare(peer: Any) -> None:
        peer.boot_offset_s = 2**32 * 1e-3 - 20.0

    _run(fake_pair, script, prepare=prepare)


def test_nothing_is_sent_after_the_end(fake_pair: Callable[..., Any]) -> None:
    async def fly() -> tuple[int, int]:
        link, peer = fake_pair("px4")
        async with peer:
            async with Driver(name="real", link=link) as driver:
                await _armed(driver)
                await driver.enter_guided()
            count = len(peer.received)
            await asyncio.sleep(5.0)
            return count, len(peer.received)

    before, after = run_virtual(fly())
    assert before == after


def test_full_text_without_an_end_is_the_reason_at_once_and_an_event_after_a_second(
    fake_pair: Callable[..., Any],
) -> None:
    """PX4 gives an id to all of its texts, and sends no empty piece after a full one."""
    reason = "Preflight Fail: Vehicle is in safety configuration"
    assert len(reason) == 50

    async def script(driver: Driver, peer: Any) -> list[VehicleEvent]:
        events: list[VehicleEvent] = []
        peer.prearm = False
        driver.on_event(events.append)
        await driver.identify(5.0)
        await asyncio.sleep(1.0)
        asyncio.get_running_loop().call_later(
            1.5, peer.say, mavlink.MAVLink_statustext_message(2, reason.encode(), 9, 0)
        )
        with pytest.raises(NotReadyError, match="Vehicle is in safety configuration"):
            await driver.ready(2.0)
        texts = [event for event in events if event.kind == "text"]
        assert texts == []
        await asyncio.sleep(1.0)
        return [event for event in events if event.kind == "text"]

    ((event),) = _run(fake_pair, script, peer_is="px4")
    assert (event.text, event.severity) == (reason, 2)
