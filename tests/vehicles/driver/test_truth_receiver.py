"""A simulator's ground truth: when it was so, where in the world, and while nobody knows."""

import asyncio
import math
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.autopilots.test_ground_truth import hil_state, sim_state
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.ardupilot.strategy import ArduCopter
from wil_campaign.vehicles.autopilots.autopilot import Autopilot, MavlinkTarget
from wil_campaign.vehicles.autopilots.px4 import Px4
from wil_campaign.vehicles.clocks.timesync import VehicleClock
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.driver.truth_receiver import TruthReceiver
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.errors import AnchorError
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.vehicles.setpoints import VelocitySetpoint
from wil_campaign.worlds.frames import Pose, Vec3, angle_between, norm, subtract

START = Pose.of(3.0, -2.0, 0.0, yaw_rad=0.0)
LATE_S = 0.02


class Simulator:
    """A simulated vehicle's side of the link; its clock began 100 s before the run clock."""

    def __init__(self, autopilot: Autopilot, *, listens: bool = True) -> None:
        link, _ = memory_pair(latency_s=0.0)
        session = MavlinkSession(link=link, own=MavlinkTarget(245, 190))
        session.target = MavlinkTarget(1, 1)
        self._session = session
        self._codec = MavlinkCodec(system_id=1, component_id=1)
        self._clock = VehicleClock()
        self.receiver = TruthReceiver(session=session, clock=self._clock)
        self.samples: list[EstimateSample] = []
        if listens:
            self.receiver.listen(self.samples.append)
        self.receiver.begin(autopilot)

    def attitude(self, t_s: float, *, late_s: float = LATE_S) -> None:
        """Let an attitude of a moment arrive."""
        boot_ms = round((t_s + 100.0) * 1e3)
        self._clock.stamped(boot_ms * 1e-3, t_s + late_s)
        still = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._arrive(mavlink.MAVLink_attitude_quaternion_message(boot_ms, *still), t_s + late_s)

    def truth(self, message: Any, t_s: float, *, late_s: float = LATE_S) -> None:
        """Let a ground truth of a moment arrive."""
        self._arrive(message, t_s + late_s)

    def stand(self, message: Any, *, until_s: float = 1.0) -> None:
        """Let the vehicle stand where a message has it."""
        for tick in range(1, round(until_s * 20)):
            self.attitude(tick / 20.0)
            self.truth(message, tick / 20.0)

    def _arrive(self, message: Any, arrived_s: float) -> None:
        self._session.received(self._codec.pack(message), arrived_s)


EASTWARDS = [
    (Px4(), hil_state(vx=0, vy=200, vz=0), hil_state(lat=473978420, vx=0, vy=200, vz=0), 11.1195),
    (
        ArduCopter(),
        sim_state(vn=0.0, ve=2.0, vd=0.0),
        sim_state(lat_int=473978420, vn=0.0, ve=2.0, vd=0.0),
        11.1319,
    ),
]


@pytest.mark.parametrize(("autopilot", "standing", "moved", "away_m"), EASTWARDS)
def test_it_is_anchored_at_the_start_pose(
    autopilot: Autopilot, standing: Any, moved: Any, away_m: float
) -> None:
    """Its nose is east and the start's is north: the simulator's north is the world's west."""
    simulator = Simulator(autopilot)
    simulator.stand(standing)
    assert simulator.samples == []
    simulator.receiver.anchor_at(START)
    simulator.attitude(2.0)
    simulator.truth(moved, 2.0)
    (sample,) = simulator.samples
    assert sample.pose.position_ned_m == pytest.approx((3.0, -2.0 - away_m, 0.0), abs=2e-3)
    assert sample.pose.yaw_rad == pytest.approx(0.0, abs=1e-6)
    assert sample.velocity_ned_m_s == pytest.approx((2.0, 0.0, 0.0), abs=1e-6)


def test_how_often_it_comes_is_known_before_it_is_anchored() -> None:
    """An attached PX4 was ready 27 ms before its preflight: one pose had been anchored."""
    simulator = Simulator(Px4())
    assert simulator.receiver.rate_hz(0.0, fresh_s=0.5) is None
    simulator.stand(hil_state(), until_s=1.5)
    assert simulator.receiver.rate_hz(1.5, fresh_s=0.5) == pytest.approx(20.0)
    assert simulator.receiver.rate_hz(2.1, fresh_s=0.5) is None
    simulator.receiver.restart()
    assert simulator.receiver.rate_hz(1.5, fresh_s=0.5) is None


def test_height_is_up_whatever_the_sea_level() -> None:
    simulator = Simulator(ArduCopter())
    simulator.stand(sim_state())
    simulator.receiver.anchor_at(START)
    simulator.attitude(2.0)
    simulator.truth(sim_state(alt=491.0), 2.0)
    assert simulator.samples[0].pose.position_ned_m[2] == pytest.approx(-1.5, abs=1e-3)


@pytest.mark.parametrize("burst_s", [0.0, 0.08])
def test_it_is_as_late_as_the_telemetry_before_it(burst_s: float) -> None:
    simulator = Simulator(ArduCopter())
    simulator.stand(sim_state())
    simulator.receiver.anchor_at(START)
    simulator.attitude(2.0, late_s=LATE_S + burst_s)
    simulator.truth(sim_state(), 2.005, late_s=LATE_S + burst_s)
    (sample,) = simulator.samples
    # The least delay so far is all that is known of the link: 20 ms of it look like none.
    assert sample.t_s == pytest.approx(2.005 + LATE_S, abs=2e-3)
    assert sample.boot_s == pytest.approx(102.005, abs=2e-3)


def test_after_a_stall_each_of_a_burst_has_its_own_time() -> None:
    """A PX4 stood for 58 ms between an attitude and its ground truth: three were lost behind it."""
    simulator = Simulator(Px4())
    simulator.stand(hil_state())
    simulator.receiver.anchor_at(START)
    simulator.attitude(2.000)
    for passed_ms, stall_ms in ((8, 58), (28, 38), (48, 18), (68, 0)):
        t_s, late_s = 2.0 + passed_ms * 1e-3, LATE_S + stall_ms * 1e-3
        if passed_ms > 8:
            simulator.attitude(t_s - 0.008, late_s=late_s + 0.008)
        simulator.truth(hil_state(time_usec=round((t_s + 100.0) * 1e6)), t_s, late_s=late_s)
    stamps = [sample.boot_s for sample in simulator.samples]
    assert stamps == pytest.approx([102.008, 102.028, 102.048, 102.068], abs=1e-3)


def test_a_time_that_telemetry_contradicts_makes_it_neither_older_nor_newer() -> None:
    simulator = Simulator(Px4())
    simulator.stand(hil_state())
    simulator.receiver.anchor_at(START)
    for t_s, time_usec in ((2.0, 101_300_000), (2.5, 1_790_000_000_000_000), (3.0, 0)):
        simulator.attitude(t_s)
        simulator.truth(hil_state(time_usec=time_usec), t_s)
    stamps = [sample.boot_s for sample in simulator.samples]
    assert stamps == pytest.approx([102.0, 102.5, 103.0], abs=1e-3)


def test_truth_that_came_long_after_any_stamp_has_no_known_time() -> None:
    simulator = Simulator(ArduCopter())
    simulator.stand(sim_state())
    simulator.receiver.anchor_at(START)
    simulator.truth(sim_state(), 3.0)
    assert simulator.samples == []


def test_a_vehicle_that_moves_is_not_anchored() -> None:
    simulator = Simulator(ArduCopter())
    simulator.stand(sim_state(), until_s=0.5)
    simulator.attitude(0.6)
    simulator.truth(sim_state(alt=490.0), 0.6)
    with pytest.raises(AnchorError, match=r"moved by 0\.50 m"):
        simulator.receiver.anchor_at(START)


def test_unusable_messages_are_named_and_dropped() -> None:
    simulator = Simulator(ArduCopter())
    simulator.stand(sim_state(lat_int=0, lon_int=0))
    simulator.receiver.anchor_at(START)
    assert simulator.receiver.count == 0
    assert "use a newer ArduPilot" in simulator.receiver.refused


def test_after_a_reboot_it_is_anchored_anew() -> None:
    simulator = Simulator(ArduCopter())
    simulator.stand(sim_state())
    simulator.receiver.anchor_at(START)
    simulator.receiver.restart()
    simulator.attitude(2.0)
    simulator.truth(sim_state(), 2.0)
    assert simulator.samples == []


def test_truth_without_a_listener_is_not_taken() -> None:
    simulator = Simulator(ArduCopter(), listens=False)
    simulator.stand(sim_state())
    assert simulator.receiver.count == 0


Script = Callable[[Driver], Awaitable[None]]


def _flown(autopilot: str) -> tuple[list[EstimateSample], list[TruthSample]]:
    """Fly up and away; return the ground truth that the driver received, and the physics'."""
    received: list[EstimateSample] = []
    true: list[TruthSample] = []
    start = Pose.of(2.0, -1.0, 0.0, yaw_rad=0.7)

    async def fly() -> None:
        ours, theirs = memory_pair(latency_s=0.01)
        config = EmbeddedConfig(autopilot=autopilot, start=start, running_s=60.0)
        async with (
            EmbeddedVehicle(config=config, link=theirs, seed=3) as vehicle,
            Driver(name="real", link=ours, start=start) as driver,
        ):
            driver.on_truth(received.append)
            vehicle.on_truth(true.append, 250.0)
            await driver.identify(5.0)
            await driver.ready(30.0)
            await driver.arm()
            await driver.begin_takeoff(3.0)
            await asyncio.sleep(8.0)
            await driver.enter_guided()
            for _ in range(60):
                driver.send(VelocitySetpoint((2.0, 1.0, 0.0)))
                await asyncio.sleep(0.05)

    run_virtual(fly())
    return received, true


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_the_embedded_vehicles_send_it_as_their_firmwares_do(autopilot: str) -> None:
    received, true = _flown(autopilot)
    history = PoseHistory(1e3)
    for truth in true:
        history.add(truth.t_s, truth.pose, truth.velocity_ned_m_s)

    def away_m(sample: EstimateSample) -> float:
        return norm(subtract(sample.pose.position_ned_m, _pose(history, sample).position_ned_m))

    assert len(received) > 400
    far: Vec3 = subtract(received[-1].pose.position_ned_m, received[0].pose.position_ned_m)
    assert norm(far) > 5.0
    # Its grid is 1.1 cm on each axis, and the last 8 ms of a flight at 2.2 m/s are 1.8 cm.
    assert max(map(away_m, received)) < 0.04
    turned = (angle_between(one.pose.q_wxyz, _pose(history, one).q_wxyz) for one in received)
    assert max(turned) < math.radians(2.0)


def _pose(history: PoseHistory, sample: EstimateSample) -> Pose:
    """Return the physics' pose at the time of a received one."""
    pose = history.at(sample.t_s).pose
    assert pose is not None
    return pose
