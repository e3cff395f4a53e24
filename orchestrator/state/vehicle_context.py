"""The context of one vehicle of a run: driver, poses, truth, setpoints, listeners."""

from collections import deque
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field
from typing import TypeVar

from wil_campaign.foundation.tasks import SuppressedErrors
from wil_campaign.orchestrator.state.liftoff_detector import LiftoffDetector
from wil_campaign.orchestrator.state.signal_faults import SignalFaults, restamp_estimate
from wil_campaign.safety.model.samples import PoseSample, ReferenceSample
from wil_campaign.vehicles.autonomy import Telemetry
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample
from wil_campaign.vehicles.faults import FaultySignal
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.vehicles.readings import PoseReading
from wil_campaign.vehicles.readings.copies import restamp_pose
from wil_campaign.vehicles.setpoints import PositionSetpoint, Setpoint, Setpoints
from wil_campaign.worlds.frames import Pose, Vec3, scale, subtract

T = TypeVar("T")

_LISTENER = SuppressedErrors("a listener to a vehicle's pose")
HISTORY_S = 2.0
"""How long poses are kept: longer than the latency of any camera."""
_MOST_NOTES = 20_000
"""How many notes of an autonomy are kept: more than 15 minutes of one that changes at 20 Hz."""
_LINK_SILENT_S = 0.3
"""Telemetry comes 50 times a second: a vehicle that is silent for so long may be lost."""
_REFER_EVERY_S = 0.098
"""Ten references a second, of any source whose period divides 0.1 s, despite rounding."""
_ZERO: Vec3 = (0.0, 0.0, 0.0)

PoseListener = Callable[[PoseSample], None]
ReferenceListener = Callable[[ReferenceSample], None]
ContactListener = Callable[[TruthSample], None]
MocapListener = Callable[[PoseReading], None]


@dataclass(slots=True)
class VehicleContext:
    """The context of one vehicle: driver, poses by its source and in truth, setpoints.

    poses: by the campaign's pose source, world frame; used by oracles and rendering. truth: ground
    truth of the embedded simulation, or of the vehicle's simulator over MAVLink; empty without
    either. setpoint: the newest of its autonomy; foreign_setpoints: kind of the newest one of
    an external program. liftoff: by the vehicle's own clock, mapped. may_drop_out: from the takeoff
    on the run continues without it. permits_dead_reckoning: as its campaign says.
    """

    name: str
    driver: Driver
    start: Pose
    pose_source: str
    poses: PoseHistory = field(default_factory=lambda: PoseHistory(HISTORY_S))
    truth: PoseHistory = field(default_factory=lambda: PoseHistory(HISTORY_S))
    setpoint: Setpoint | None = None
    foreign_setpoints: Setpoints | None = None
    liftoff: LiftoffDetector = field(default_factory=LiftoffDetector)
    contact: str | None = None
    may_drop_out: bool = False
    permits_dead_reckoning: bool = False
    _has_own_truth: bool = False
    _faulty_estimate: FaultySignal[EstimateSample] | None = None
    _faulty_simulator: FaultySignal[EstimateSample] | None = None
    _faulty_mocap: FaultySignal[PoseReading] | None = None
    _listeners: list[PoseListener] = field(default_factory=list)
    _reference_listeners: list[ReferenceListener] = field(default_factory=list)
    _contact_listeners: list[ContactListener] = field(default_factory=list)
    _mocap_listeners: list[MocapListener] = field(default_factory=list)
    _refer_due_s: dict[str, float] = field(default_factory=dict)
    _notes: deque[tuple[float, str]] = field(default_factory=lambda: deque(maxlen=_MOST_NOTES))

    @property
    def note(self) -> str:
        """Return the newest note of the vehicle's autonomy; empty without one."""
        return self._notes[-1][1] if self._notes else ""

    def note_at(self, t_s: float) -> str:
        """Return the newest note that the autonomy gave until a time; empty without one."""
        return next((text for noted_s, text in reversed(self._notes) if noted_s <= t_s), "")

    def take_note(self, t_s: float, text: str) -> None:
        """Take what the vehicle's autonomy notes with a command."""
        if text != self.note:
            self._notes.append((t_s, text))

    @property
    def steered_by(self) -> Setpoints | None:
        """Return the vehicle's last setpoint of its autonomy; None before the first."""
        if self.setpoint is None:
            return self.foreign_setpoints
        return "position" if isinstance(self.setpoint, PositionSetpoint) else "velocity"

    def inject(self, faults: SignalFaults) -> None:
        """Inject the campaign's faults of the vehicle's pose source."""
        if self.pose_source == "mocap":
            self._faulty_mocap = faults.signal(self.name, None, restamp_pose)
        elif self.pose_source == "simulator":
            self._faulty_simulator = faults.signal(self.name, None, restamp_estimate)
        else:
            self._faulty_estimate = faults.signal(self.name, None, restamp_estimate)

    def on_pose(self, listener: PoseListener) -> None:
        """Call `listener` with each pose of the vehicle's pose source."""
        self._listeners.append(listener)

    def on_reference(self, listener: ReferenceListener) -> None:
        """Call `listener` with the vehicle's poses by its other sources."""
        self._reference_listeners.append(listener)

    def on_contact(self, listener: ContactListener) -> None:
        """Call `listener` with the truth at the vehicle's first physical contact."""
        self._contact_listeners.append(listener)

    def on_mocap(self, listener: MocapListener) -> None:
        """Call `listener` with each motion capture reading of the vehicle."""
        self._mocap_listeners.append(listener)

    def height_m(self) -> float | None:
        """Return the vehicle's height above its start by its estimate; None while unknown."""
        estimate = self.driver.estimate
        if estimate is None:
            return None
        return self.start.position_ned_m[2] - estimate.pose.position_ned_m[2]

    def telemetry(self) -> Telemetry | None:
        """Return the vehicle's own estimate for its autonomy; None while unknown."""
        estimate = self.driver.estimate
        if estimate is None:
            return None
        return Telemetry(estimate.t_s, estimate.pose, estimate.velocity_ned_m_s)

    def receive_estimate(self, sample: EstimateSample) -> None:
        """Process an estimate of the vehicle's autopilot."""
        if self.driver.state.armed:
            self._detect_liftoff(sample)
        self._receive_sample("mavlink", _pass_fault(self._faulty_estimate, sample))

    def receive_simulator(self, sample: EstimateSample) -> None:
        """Process a ground truth of the vehicle that its simulator sent over MAVLink."""
        if not self._has_own_truth:
            self.truth.add(sample.t_s, sample.pose, sample.velocity_ned_m_s)
        self._receive_sample("simulator", _pass_fault(self._faulty_simulator, sample))

    def receive_mocap(self, captured: PoseReading) -> None:
        """Process a motion capture pose of the vehicle."""
        reading = _pass_fault(self._faulty_mocap, captured)
        if reading is None:
            return
        for listener in self._mocap_listeners:
            with _LISTENER:
                listener(reading)
        if self.pose_source != "mocap":
            self._refer("mocap", reading.t_s, reading.pose, reading.velocity_ned_m_s or _ZERO)
            return
        velocity = reading.velocity_ned_m_s or self._mocap_velocity(reading)
        self._receive_pose(reading.t_s, reading.pose, velocity)

    def receive_truth(self, sample: TruthSample) -> None:
        """Process the true pose of an embedded vehicle."""
        self._has_own_truth = True
        self.truth.add(sample.t_s, sample.pose, sample.velocity_ned_m_s)
        self._refer("truth", sample.t_s, sample.pose, sample.velocity_ned_m_s)
        if sample.contact is not None and self.contact is None:
            self.contact = sample.contact
            for listener in self._contact_listeners:
                with _LISTENER:
                    listener(sample)

    def _receive_sample(self, source: str, sample: EstimateSample | None) -> None:
        """Take a sample as a pose if it is of the pose source, else as a reference."""
        if sample is None:
            return
        if source == self.pose_source:
            self._receive_pose(sample.t_s, sample.pose, sample.velocity_ned_m_s)
        else:
            self._refer(source, sample.t_s, sample.pose, sample.velocity_ned_m_s)

    def _receive_pose(self, t_s: float, pose: Pose, velocity_ned_m_s: Vec3) -> None:
        if not self.poses.add(t_s, pose, velocity_ned_m_s):
            return
        sample = PoseSample(t_s, self.name, pose, velocity_ned_m_s)
        for listener in self._listeners:
            with _LISTENER:
                listener(sample)

    def _refer(self, source: str, t_s: float, pose: Pose, velocity_ned_m_s: Vec3) -> None:
        if t_s < self._refer_due_s.get(source, 0.0):
            return
        self._refer_due_s[source] = t_s + _REFER_EVERY_S
        sample = ReferenceSample(
            t_s, self.name, source, pose.position_ned_m, velocity_ned_m_s, pose.q_wxyz
        )
        for listener in self._reference_listeners:
            listener(sample)

    def _mocap_velocity(self, reading: PoseReading) -> Vec3:
        """Return the vehicle's velocity by motion capture over a tenth of a second."""
        earlier = self.poses.at(reading.t_s - 0.1)
        if earlier.pose is None or earlier.kind != "interpolated":
            return _ZERO
        moved = subtract(reading.pose.position_ned_m, earlier.pose.position_ned_m)
        return scale(moved, 10.0)

    def _detect_liftoff(self, sample: EstimateSample) -> None:
        height_m = self.start.position_ned_m[2] - sample.pose.position_ned_m[2]
        climb_m_s = -sample.velocity_ned_m_s[2]
        self.liftoff.observe(
            sample.t_s,
            height_m=height_m,
            climb_m_s=climb_m_s,
            doubt_s=self.driver.clock.uncertainty_s or 0.0,
        )


def _pass_fault(fault: FaultySignal[T] | None, sample: T) -> T | None:
    """Return a vehicle's sample with its fault injected; None while the signal has stopped."""
    return sample if fault is None else fault.passed(sample)


def is_any_silent(
    contexts: Iterable[VehicleContext], dropped_out: Collection[str], now_s: float
) -> bool:
    """Return whether no message has arrived from some vehicle for a while: it may be lost.

    dropped_out: the names of those of which none is awaited any more.
    """
    awaited = (one for one in contexts if one.name not in dropped_out)
    received_s = (one.driver.state.last_received_s for one in awaited)
    return any(t_s is None or now_s - t_s > _LINK_SILENT_S for t_s in received_s)
