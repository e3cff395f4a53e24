"""The gate autonomy flies a point mass with lag through a gate that is drawn for its camera."""

import math
from collections import deque
from dataclasses import dataclass, field

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wil_campaign.campaigns.autonomies.gate import GateAutonomy
from wil_campaign.campaigns.autonomies.gate_parameters import parse_gate_parameters
from wil_campaign.campaigns.autonomies.gate_range import Looming
from wil_campaign.vehicles.autonomy import Autonomy, Command, Telemetry
from wil_campaign.vehicles.readings import BgrImage, CameraReading
from wil_campaign.vehicles.setpoints import VelocitySetpoint
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, Vec3, quat_from_euler

CAMERA = Intrinsics.from_fov(640, 480, math.radians(69.0))
PICTURE_S = 1.0 / 15.0
TURN_S = 0.04
LAG_S = 0.35
GRAVITY_M_S2 = 9.81


@dataclass(frozen=True)
class Gate:
    """A flat square frame across the north axis, metres."""

    north_m: float = 3.0
    east_m: float = 0.0
    up_m: float = 1.2
    inner_m: float = 1.0
    bar_m: float = 0.1


SUBPIXEL_BITS = 4


def draw(gate: Gate, camera: Pose, noise: np.random.Generator | None = None) -> BgrImage:
    """Return the picture: the frame's eight corners, projected, and filled between."""
    image = np.full((CAMERA.height_px, CAMERA.width_px, 3), (110, 105, 100), np.uint8)
    outlines = [
        square(gate, camera, half_m) for half_m in (gate.inner_m / 2, gate.inner_m / 2 + gate.bar_m)
    ]
    if all(outline is not None for outline in outlines):
        cv2.fillPoly(image, outlines, (0, 140, 235), shift=SUBPIXEL_BITS)
    if noise is not None:
        grain = noise.integers(-6, 7, image.shape, dtype=np.int8)
        image = (image.astype(np.int16) + grain).clip(0, 255).astype(np.uint8)
    return image


def square(gate: Gate, camera: Pose, half_m: float) -> np.ndarray | None:
    """Return the corners of a square about the gate's centre; None when not all are in front."""
    corners = []
    for right, down in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        point = (gate.north_m, gate.east_m + right * half_m, -gate.up_m + down * half_m)
        pixel = CAMERA.project(camera.to_local(point))
        if pixel is None or max(map(abs, pixel)) > 20_000:
            return None
        corners.append([round(x * 2**SUBPIXEL_BITS) for x in pixel])
    return np.array(corners, np.int32)


@dataclass
class Flight:
    """A point mass that follows velocities with a lag, leans when it accelerates, is blown."""

    start: Vec3 = (0.0, 0.0, -1.2)
    yaw_rad: float = 0.0
    latency_s: float = 0.08
    gust_m_s: float = 0.0
    blind_from_s: float = math.inf
    blind_until_s: float = math.inf
    noise: np.random.Generator | None = None
    path: list[Vec3] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)

    def fly(self, autonomy: Autonomy, gate: Gate | None, duration_s: float = 25.0) -> None:
        position, velocity = np.array(self.start), np.zeros(3)
        lean = (0.0, 0.0)
        pictures: deque[CameraReading] = deque()
        for turn in range(int(duration_s / TURN_S)):
            t_s = turn * TURN_S
            pose = Pose(tuple(position), quat_from_euler(*lean, self.yaw_rad))
            self.path.append(pose.position_ned_m)
            if gate is not None and t_s // PICTURE_S > (t_s - TURN_S) // PICTURE_S:
                hidden = self.blind_from_s <= t_s < self.blind_until_s
                shown = Gate(north_m=-100.0) if hidden else gate
                image = draw(shown, pose, self.noise)
                pictures.append(CameraReading(t_s, t_s + self.latency_s, 0, "mixed", image, CAMERA))
            while pictures and pictures[0].arrived_s <= t_s:
                autonomy.perceive(pictures.popleft())
            command = autonomy.act(
                Telemetry(t_s, pose, (float(velocity[0]), float(velocity[1]), float(velocity[2])))
            )
            self.commands.append(command)
            self.notes.append(command.note)
            assert isinstance(command.setpoint, VelocitySetpoint)
            wanted = np.array(command.setpoint.velocity_ned_m_s)
            wanted[1] += self.gust_m_s * math.sin(0.7 * t_s)
            acceleration = (wanted - velocity) / LAG_S
            velocity = velocity + acceleration * TURN_S
            position = position + velocity * TURN_S
            lean = self._lean(acceleration)
            if command.done:
                return

    def _lean(self, acceleration: np.ndarray) -> tuple[float, float]:
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        ahead = acceleration[0] * cos + acceleration[1] * sin
        right = acceleration[1] * cos - acceleration[0] * sin
        return (math.atan2(right, GRAVITY_M_S2), -math.atan2(ahead, GRAVITY_M_S2))

    def crossing(self, gate: Gate) -> tuple[float, float]:
        """Return by how much the gate's centre was missed to the east and downwards."""
        for before, after in zip(self.path, self.path[1:], strict=False):
            if before[0] < gate.north_m <= after[0]:
                f = (gate.north_m - before[0]) / (after[0] - before[0])
                east, down = (before[i] + f * (after[i] - before[i]) for i in (1, 2))
                return east - gate.east_m, down + gate.up_m
        raise AssertionError(f"never came to the gate: {self.path[-1]}, {self.notes[-1]}")


def make(**parameters: object) -> GateAutonomy:
    return GateAutonomy(goal={"altitude_m": 1.2}, parameters=parameters, seed=1)


STARTS = [
    (0.0, 0.0, -1.2),
    (0.0, 0.6, -1.0),
    (0.0, -0.8, -1.4),
    (0.8, 0.9, -1.2),
    (-1.0, 0.4, -0.9),
]


@pytest.mark.parametrize("inner_m", [1.0, 0.5])
@pytest.mark.parametrize("start", STARTS)
def test_it_flies_through_the_middle_and_stops_behind(inner_m: float, start: Vec3) -> None:
    gate, flight = Gate(inner_m=inner_m), Flight(start=start)
    flight.fly(make(), gate)
    east_m, down_m = flight.crossing(gate)
    assert math.hypot(east_m, down_m) < 0.05
    assert flight.commands[-1].done
    assert flight.path[-1][0] == pytest.approx(gate.north_m + 0.6, abs=0.1)
    assert [note for i, note in enumerate(flight.notes) if note not in flight.notes[:i]] == [
        "search",
        "approach",
        "through",
        "stop",
    ]


def test_it_does_not_know_the_way_to_the_gate_nor_which_way_north_is() -> None:
    """A flight elsewhere, on another heading, goes through the gate as well.

    The gate is drawn north of the vehicle, so the telemetry is turned instead.
    """
    turn_rad = math.radians(130.0)

    class Turned:
        def __init__(self, inner: GateAutonomy) -> None:
            self.inner = inner

        def perceive(self, reading: CameraReading) -> None:
            self.inner.perceive(reading)

        def act(self, telemetry: Telemetry) -> Command:
            frame = Pose((7.0, -4.0, 0.0), quat_from_euler(0.0, 0.0, turn_rad))
            still = Pose((0.0, 0.0, 0.0), frame.q_wxyz)
            command = self.inner.act(
                Telemetry(
                    telemetry.t_s,
                    frame.compose(telemetry.pose),
                    still.to_parent(telemetry.velocity_ned_m_s),
                )
            )
            assert isinstance(command.setpoint, VelocitySetpoint)
            assert command.setpoint.yaw_rad == pytest.approx(turn_rad)
            back = still.to_local(command.setpoint.velocity_ned_m_s)
            return Command(VelocitySetpoint(back), command.done, command.note)

    gate, flight = Gate(north_m=2.5, inner_m=0.5), Flight(start=(0.0, 0.3, -1.1))
    flight.fly(Turned(make()), gate)  # type: ignore[arg-type]  # takes pictures only
    assert math.hypot(*flight.crossing(gate)) < 0.05


def test_gusts_noise_and_more_latency() -> None:
    gate = Gate(inner_m=0.5)
    flight = Flight(
        start=(0.0, 0.4, -1.3), latency_s=0.1, gust_m_s=0.15, noise=np.random.default_rng(5)
    )
    flight.fly(make(), gate)
    assert math.hypot(*flight.crossing(gate)) < 0.1
    assert flight.commands[-1].done


def test_a_gate_that_is_cut_off_at_the_start_is_brought_into_view_first() -> None:
    gate, flight = Gate(), Flight(start=(1.4, -1.3, -1.2))
    flight.fly(make(), gate)
    assert math.hypot(*flight.crossing(gate)) < 0.06
    assert flight.commands[-1].done


def test_a_gate_that_vanishes_on_the_way_stops_it_until_it_is_back() -> None:
    gate, flight = Gate(), Flight(blind_from_s=1.5, blind_until_s=4.0)
    flight.fly(make(), gate)
    turn = int(4.0 / TURN_S)
    assert flight.notes[turn] == "search"
    assert flight.path[turn][0] - flight.path[turn - 10][0] == pytest.approx(0.0, abs=0.03)
    assert math.hypot(*flight.crossing(gate)) < 0.05
    assert flight.commands[-1].done


def test_it_hovers_and_gives_up_without_a_gate_but_is_never_done() -> None:
    flight = Flight(start=(0.0, 0.0, -1.0))
    flight.fly(make(search_timeout_s=5.0), None, duration_s=8.0)
    assert flight.notes[0] == "search"
    assert flight.notes[-1] == "gave up"
    assert not any(command.done for command in flight.commands)
    assert flight.path[-1] == pytest.approx((0.0, 0.0, -1.2), abs=0.05)


def test_a_camera_that_falls_silent_far_from_the_gate_stops_the_flight() -> None:
    gate, flight, autonomy = Gate(), Flight(), make()
    flight.fly(autonomy, gate, duration_s=1.5)
    assert flight.notes[-1] == "approach"
    still = Pose((0.5, 0.0, -1.2))
    commands = [
        autonomy.act(Telemetry(1.5 + turn * TURN_S, still, (0.0, 0.0, 0.0))) for turn in range(60)
    ]
    assert commands[-1].note == "search"
    assert commands[-1].setpoint.velocity_ned_m_s == pytest.approx((0, 0, 0), abs=0.05)  # type: ignore[union-attr]  # it asks for velocities


def test_it_repeats_to_the_bit() -> None:
    paths = []
    for _ in range(2):
        flight = Flight(start=(0.0, 0.3, -1.1))
        flight.fly(make(), Gate(inner_m=0.5), duration_s=3.0)
        paths.append(flight.path)
    assert paths[0] == paths[1]


def test_it_is_an_autonomy() -> None:
    assert isinstance(make(), Autonomy)


def test_faults_of_parameters_are_reported_by_name() -> None:
    with pytest.raises(ValueError, match=r"unknown parameter 'sped_m_s'.*speed_m_s"):
        make(sped_m_s=1.0)
    with pytest.raises(ValueError, match=r"speed_m_s must be greater than 0.*color must be one of"):
        make(speed_m_s=-1.0, color="beige")
    for wrong in ({"kp": "much"}, {"kp": True}, {"kp": math.nan}, {"camera_stabilized": 1}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            make(**wrong)
    with pytest.raises(ValueError, match="altitude_m"):
        GateAutonomy(goal={}, parameters={}, seed=1)
    assert parse_gate_parameters({"ki": 0, "speed_m_s": 1}).ki == 0


@settings(max_examples=50)
@given(st.floats(0.3, 2.0), st.floats(1.5, 6.0))
def test_growth_tells_how_far_and_how_large(width_m: float, gate_m: float) -> None:
    looming = Looming()
    assert looming.fit() is None
    for tenth in range(10):
        along_m = tenth * 0.1
        looming.add(along_m, width_m / (gate_m - along_m))
    found = looming.fit()
    assert found is not None
    assert found.along_m == pytest.approx(gate_m, rel=1e-6)
    assert found.width_m == pytest.approx(width_m, rel=1e-6)


def test_a_gate_of_constant_size_has_no_range() -> None:
    looming = Looming()
    for tenth in range(10):
        looming.add(tenth * 0.1, 0.3)
    assert looming.fit() is None
