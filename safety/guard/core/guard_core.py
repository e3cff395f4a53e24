"""The guard's core: bytes, positions, commands and ticks in; bytes and events out.

Pure. Its decisions depend only on its inputs and their times, never on a clock or a socket, so
that the same core runs in this process under virtual time and in its own process.

A runtime-assurance filter in the pattern of ASTM F3269: normally the orchestrator's frames are
forwarded; once it latches they are not, and its own contingency brings every vehicle down.
"""

from collections.abc import Mapping, Sequence

from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.commands import (
    AnchorAt,
    BringDown,
    ClocksApart,
    CoreMessage,
    NewFences,
    OperatorAction,
    OrchestratorAlive,
    OrchestratorEnded,
    VehicleGone,
)
from wil_campaign.safety.guard.core.contingency import (
    ContingencyAction,
    ContingencyPhase,
    ContingencyPlan,
)
from wil_campaign.safety.guard.core.events import (
    Cause,
    EventKind,
    GuardedVehicle,
    GuardEvent,
    GuardSettings,
    Output,
    Outputs,
    ToGcs,
    ToOrchestrator,
    ToVehicle,
)
from wil_campaign.safety.guard.core.fence_exchange import refusal_of_changes
from wil_campaign.safety.guard.core.frame_filter import (
    frame_name,
    is_control_frame,
    is_harmless_frame,
    is_read_only_frame,
    is_stick_input,
)
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.core.setpoint_frames import SETPOINTS
from wil_campaign.safety.guard.core.vehicle_supervisor import SupervisedVehicle
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.autopilots.autopilot import own_heartbeat
from wil_campaign.vehicles.mavlink.fields import (
    COMMAND_INT,
    COMMAND_LONG,
    EXTENDED_SYS_STATE,
    HEARTBEAT,
    LOCAL_POSITION_NED,
    SET_MODE,
    command_in_frame,
    read_set_mode,
)
from wil_campaign.vehicles.mavlink.framing import MavlinkFrame
from wil_campaign.vehicles.poses.anchor import Anchor
from wil_campaign.worlds.frames import Vec3

_READ = frozenset({HEARTBEAT, EXTENDED_SYS_STATE, LOCAL_POSITION_NED})
_STILL_S = 0.2
"""Of several ticks: a guard that was late by so much says so, for it may be what was silent."""
_RECEIVED_S = 1.5
"""A vehicle that sends a HEARTBEAT each second is heard at least as often."""
_MOST_DROPPED = 200
"""Kinds of frames that were not forwarded: a sender that makes names up fills no disk."""
_COMMANDS = frozenset({COMMAND_LONG, COMMAND_INT, SET_MODE})


class GuardCore:
    """The guard's pure core: supervises its vehicles and brings them down when it must.

    Once latched, it stays latched: `latched` is the first cause. Every method returns what is to be
    sent and recorded, in that order. Input bytes may be split anywhere; outputs are whole frames.
    """

    def __init__(
        self,
        *,
        vehicles: Mapping[str, GuardedVehicle],
        settings: GuardSettings | None = None,
        plan: ContingencyPlan | None = None,
    ) -> None:
        self.settings = settings or GuardSettings()
        base = plan or ContingencyPlan()
        self._supervised_vehicles = {
            name: SupervisedVehicle(name, vehicle, self.settings, base)
            for name, vehicle in vehicles.items()
        }
        self.latched: Cause | None = None
        self.paused = False
        self.dropped: dict[tuple[str, str], int] = {}
        """How many frames of the orchestrator were not forwarded, by vehicle and message."""
        self._alive_s: float | None = None
        self._ticked_s: float | None = None
        self._reported_of_all: set[str] = set()

    @property
    def phases(self) -> dict[str, ContingencyPhase]:
        """Return the contingency phase of each vehicle in the guard."""
        return {
            name: supervised.contingency.phase
            for name, supervised in self._supervised_vehicles.items()
        }

    @property
    def all_down(self) -> bool:
        """Return whether the guard latched and every vehicle is disarmed or ended."""
        return self.latched is not None and all(
            supervised.contingency.down
            or supervised.is_out_of_reach
            or supervised.seen.last_received_s is None
            for supervised in self._supervised_vehicles.values()
        )

    def may_be_armed(self, t_s: float) -> tuple[str, ...]:
        """Return the guard's vehicles that are armed or were just commanded to arm."""
        return tuple(
            name
            for name, supervised in self._supervised_vehicles.items()
            if not supervised.is_out_of_reach and supervised.seen.may_be_armed(t_s)
        )

    def last_received_s(self, name: str) -> float | None:
        """Return when the guard last received anything from a vehicle; None for never."""
        return self._supervised_vehicles[name].seen.last_received_s

    def from_vehicle(self, name: str, data: bytes, t_s: float) -> Outputs:
        """Take bytes from a vehicle: they are always forwarded."""
        frames = self.split_from_vehicle(name, data)
        if not frames:
            return ()
        raw, judged = tuple([frame.raw for frame in frames]), self.judge_vehicle(name, frames, t_s)
        has_gcs = self._supervised_vehicles[name].vehicle.gcs
        to_gcs = (ToGcs(name, raw),) if has_gcs else ()
        return (ToOrchestrator(name, raw), *to_gcs, *judged)

    def split_from_vehicle(self, name: str, data: bytes) -> list[MavlinkFrame]:
        """Return the whole frames in bytes from a vehicle: to be forwarded, and then judged."""
        return self._supervised_vehicles[name].from_vehicle.feed(data)

    def judge_vehicle(self, name: str, frames: Sequence[MavlinkFrame], t_s: float) -> Outputs:
        """Judge a vehicle's frames, which were forwarded; return the guard's reaction."""
        supervised = self._supervised_vehicles[name]
        out: list[Output] = []
        is_received = False
        for frame in supervised.own_frames(frames, t_s):
            if not is_received:
                is_received = True
                supervised.seen.last_received_s = t_s
                if supervised.lost:
                    out.append(self._report_received_again(supervised, t_s))
            if frame.message_id in _READ:
                out += self._read_frame(supervised, frame, t_s)
        return tuple(out)

    def from_orchestrator(self, name: str, data: bytes, t_s: float) -> Outputs:
        """Take bytes from the orchestrator: forwarded while it is in command."""
        supervised = self._supervised_vehicles[name]
        forwarded: list[bytes] = []
        events: list[Output] = []
        for frame in supervised.from_orchestrator.feed(data):
            if self._passes(supervised, frame, t_s):
                is_setpoint = frame.message_id in SETPOINTS
                raw = supervised.pass_setpoint(frame, t_s) if is_setpoint else frame.raw
                if raw:
                    forwarded.append(raw)
            else:
                events += self._drop(supervised, frame, t_s)
        events += self._limitings(supervised, t_s)
        if not forwarded:
            return tuple(events)
        return (ToVehicle(name, tuple(forwarded)), *events)

    def from_gcs(self, name: str, data: bytes, t_s: float) -> Outputs:
        """Take bytes from a ground station: it reads, and it takes over; control is a takeover.

        Whatever else it sends would change what the flight was checked with, from before arming on:
        it is not forwarded until a pilot has control. Positions of sticks are, for they are a
        pilot's way out, but the flight is no test any more. A command for another vehicle is no
        takeover of this one: ground stations send everything on all of their links.
        """
        supervised = self._supervised_vehicles[name]
        frames = supervised.from_gcs.feed(data)
        forwarded: list[bytes] = []
        events: list[Output] = []
        for frame in frames:
            is_forwarded, more = self._admit(supervised, frame, t_s)
            events += more
            if is_forwarded:
                forwarded.append(frame.raw)
        return (*((ToVehicle(name, tuple(forwarded)),) if forwarded else ()), *events)

    def _admit(
        self, supervised: SupervisedVehicle, frame: MavlinkFrame, t_s: float
    ) -> tuple[bool, Outputs]:
        """Return whether a ground station's frame is forwarded, and the guard's reaction to it."""
        seen, system = supervised.seen, supervised.vehicle.target.system
        if seen.taken_over or is_read_only_frame(frame):
            return True, ()
        by = f"the ground station {frame.system}/{frame.component}"
        if is_control_frame(frame, system):
            if not seen.may_be_armed(t_s):
                return True, ()
            seen.taken_over = True
            text = f"{by} took {supervised.name} over by {frame_name(frame)}"
            return True, tuple(self._latch("takeover", supervised.name, text, t_s))
        if is_stick_input(frame, system):
            if not seen.may_be_armed(t_s):
                return True, ()
            text = (
                f"{by} sends positions of sticks to {supervised.name} in flight "
                f"({frame_name(frame)}): switch its joystick off for a test"
            )
            return True, tuple(self._report_once(supervised, "steered", text, t_s))
        return False, self._drop(supervised, frame, t_s, f"{frame_name(frame)} from {by}")

    def position(self, sample: PoseSample) -> Outputs:
        """Take a vehicle's position, from the fastest available source."""
        place, velocity = sample.pose.position_ned_m, sample.velocity_ned_m_s
        return self.place(sample.vehicle, place, velocity, sample.t_s)

    def place(self, name: str, position_ned_m: Vec3, velocity_ned_m_s: Vec3, t_s: float) -> Outputs:
        """Take a vehicle's position in the world, as `position` does."""
        supervised = self._supervised_vehicles[name]
        return self._place(supervised, position_ned_m, velocity_ned_m_s, t_s, reported=True)

    def apply(self, message: CoreMessage, t_s: float) -> Outputs:  # noqa: PLR0911 - one a message
        """Execute a command, or act on what the guard's process found.

        Raises ValueError for an operator's geofence: its document is read first, see `NewFences`.
        """
        match message:
            case OrchestratorAlive():
                return self._note_alive(t_s)
            case OperatorAction(command):
                return self._operate(command, t_s)
            case BringDown(reason):
                return self._bring_down(reason, t_s)
            case NewFences():
                return self._change_fences(message, t_s)
            case AnchorAt(vehicle, origin_ned_m, turn_rad):
                self._supervised_vehicles[vehicle].seen.anchor = Anchor(origin_ned_m, turn_rad)
                return ()
            case OrchestratorEnded():
                if not self.may_be_armed(t_s):
                    return ()
                return tuple(self._latch("silence", "", "the orchestrator ended", t_s))
            case VehicleGone(vehicle, text):
                supervised = self._supervised_vehicles[vehicle]
                supervised.gone = supervised.lost = True
                return tuple(self._latch("lost", vehicle, text, t_s))
            case ClocksApart(vehicle, text):
                return tuple(self._latch("clock", vehicle, text, t_s))

    def _bring_down(self, reason: str, t_s: float) -> Outputs:
        """Land what the orchestrator flies: it has its own reason, and commands others nothing."""
        for supervised in self._supervised_vehicles.values():
            supervised.seen.leave_to_others()
        return tuple(self._latch("bring_down", "", reason, t_s))

    def _note_alive(self, t_s: float) -> Outputs:
        last_s, self._alive_s = self._alive_s, t_s
        if last_s is None or t_s - last_s <= self.settings.orchestrator_silent_s:
            return ()
        return (self._event(t_s, "heard", "", "messages from the orchestrator arrive again"),)

    def _operate(self, command: OperatorCommand, t_s: float) -> Outputs:
        """Execute an operator's command. Abort has priority and is final."""
        who = command.who
        if command.kind == "geofence":
            raise ValueError("the guard takes parsed fences, not a file's text")
        if command.kind == "abort":
            return tuple(self._latch("abort", "", f"aborted by {who}", t_s))
        if self.latched is not None:
            return (
                self._event(
                    t_s, "refused", "", f"{who}: {command.kind}: all vehicles are landing already"
                ),
            )
        if command.kind == "hold":
            if self.paused:
                return (self._event(t_s, "refused", "", f"{who}: hold: all vehicles hold already"),)
            self.paused = True
            out: list[Output] = []
            for supervised in self._supervised_vehicles.values():
                supervised.seen.note_pause()
                actions = supervised.contingency.pause(supervised.seen.facts(t_s), t_s)
                out += self._send(supervised, actions, t_s)
            return (*out, self._event(t_s, "hold", "", f"held by {who}"))
        if not self.paused:
            return (self._event(t_s, "refused", "", f"{who}: resume: no vehicle holds"),)
        self.paused = False
        for supervised in self._supervised_vehicles.values():
            supervised.contingency.resume(t_s)
            supervised.seen.note_resume(t_s)
        return (self._event(t_s, "resume", "", f"resumed by {who}"), *self._notes(t_s))

    def _change_fences(self, new: NewFences, t_s: float) -> Outputs:
        """Change vehicles' fences, all or none; an event says which, and why.

        The present fences apply while new ones that were only proposed are uploaded.
        """
        if why := self._refusal_of(new.fences, t_s):
            return (self._event(t_s, "refused", "", f"{new.who}: geofence: {why}"),)
        names = " and ".join(new.fences)
        if new.proposed:
            text = (
                f"{new.who} requests another fence for {names}; the old one applies until the "
                "autopilot has the new one"
            )
            return (self._event(t_s, "proposed", "", text),)
        for name, fence in new.fences.items():
            self._supervised_vehicles[name].change_fence(fence)
        return (self._event(t_s, "geofence", "", f"{new.who} changed the fence of {names}"),)

    def _refusal_of(self, fences: Mapping[str, Fence], t_s: float) -> str:
        if self.latched is not None:
            return "all vehicles are landing"
        motions = {name: self._supervised_vehicles[name].seen.motion(t_s) for name in fences}
        return refusal_of_changes(fences, motions, self.settings)

    def tick(self, t_s: float) -> Outputs:
        """Take that time has passed; called at 20 Hz, the rate of setpoints."""
        out: list[Output] = []
        silent_s = 0.0 if self._alive_s is None else t_s - self._alive_s
        still_s = 0.0 if self._ticked_s is None else t_s - self._ticked_s
        self._ticked_s = t_s
        if silent_s > self.settings.orchestrator_silent_s:
            stood = f"; the guard stood still for {still_s:.1f} s itself"
            text = "no heartbeat from the orchestrator" + (stood if still_s > _STILL_S else "")
            out += self._latch("silence", "", text, t_s)
        for supervised in self._supervised_vehicles.values():
            out += self._check_lost(supervised, t_s)
            out += self._check_unplaced(supervised, t_s)
            if supervised.meter is not None:
                supervised.meter.lapse(t_s)
                out += self._limitings(supervised, t_s)
        for supervised in self._supervised_vehicles.values():
            if supervised.contingency.phase is not ContingencyPhase.IDLE and not supervised.gone:
                actions = supervised.contingency.step(supervised.seen.facts(t_s), t_s)
                out += self._send(supervised, actions, t_s)
        return tuple(out)

    def _report_received_again(self, supervised: SupervisedVehicle, t_s: float) -> GuardEvent:
        supervised.lost = False
        return self._event(
            t_s, "heard", supervised.name, f"messages from {supervised.name} arrive again"
        )

    def _check_lost(self, supervised: SupervisedVehicle, t_s: float) -> Outputs:
        received_s = supervised.seen.last_received_s
        if received_s is None or supervised.lost or not supervised.seen.may_be_armed(t_s):
            return ()
        if t_s - received_s <= self.settings.vehicle_lost_s:
            return ()
        supervised.lost = True
        text = f"nothing received from {supervised.name} for {self.settings.vehicle_lost_s:g} s"
        return tuple(self._latch("lost", supervised.name, text, t_s))

    def _check_unplaced(self, supervised: SupervisedVehicle, t_s: float) -> Outputs:
        """Land a vehicle whose positions end while it is heard: its fence cannot be held."""
        seen, lost_s = supervised.seen, self.settings.vehicle_lost_s
        if seen.placed_s is None or t_s - seen.placed_s <= lost_s or supervised.fence is None:
            return ()
        is_received = t_s - (seen.last_received_s or 0.0) <= _RECEIVED_S
        flies = bool(seen.may_be_armed(t_s)) and not seen.on_ground
        if not is_received or not flies or supervised.contingency.started:
            return ()
        text = f"no position of {supervised.name} for {lost_s:g} s: its fence cannot be held"
        return tuple(self._latch("lost", supervised.name, text, t_s))

    def _read_frame(
        self, supervised: SupervisedVehicle, frame: MavlinkFrame, t_s: float
    ) -> Outputs:
        if frame.message_id == LOCAL_POSITION_NED:
            if supervised.seen.anchor is None and self.latched is None:
                return ()
            placed = supervised.seen.read_position(frame, t_s)
            return () if placed is None else self._place(supervised, *placed, t_s)
        change = supervised.seen.read_state(frame, t_s, supervised.commanded)
        if change is None:
            return ()
        return tuple(
            self._latch(change.kind, supervised.name, f"{supervised.name}: {change.text}", t_s)
        )

    def _place(
        self,
        supervised: SupervisedVehicle,
        position_ned_m: Vec3,
        velocity_ned_m_s: Vec3,
        t_s: float,
        *,
        reported: bool = False,
    ) -> Outputs:
        seen = supervised.seen
        if why := seen.doubt(position_ned_m, velocity_ned_m_s, t_s, reported=reported):
            return tuple(self._report_once(supervised, "pose", why, t_s))
        seen.place(position_ned_m, velocity_ned_m_s, t_s)
        if "fence" in supervised.reported or not supervised.seen.may_be_armed(t_s):
            return ()
        breach = supervised.breach(t_s)
        if breach is None:
            return ()
        return tuple(self._latch("fence", supervised.name, f"{supervised.name} {breach}", t_s))

    def _passes(self, supervised: SupervisedVehicle, frame: MavlinkFrame, t_s: float) -> bool:
        lands = self.latched is not None or supervised.contingency.started
        if lands or self.paused:
            seen = supervised.seen
            # Holding vehicles may get another fence; that moves none of them. One that lands, or
            # that a pilot flies, keeps its failsafes, its return altitude and its fence until it
            # is disarmed; then it gets back what it had before the run.
            still = not lands or not seen.may_be_armed(t_s)
            return is_harmless_frame(frame, configures=still)
        if frame.message_id not in _COMMANDS:
            return True
        command = command_in_frame(frame)
        if command is None:
            supervised.seen.note_mode_request(read_set_mode(frame), t_s)
            return True
        if command.cuts_motors and not supervised.vehicle.may_terminate:
            return False
        if not is_harmless_frame(
            frame, configures=False
        ):  # a request for a message changes no mode
            supervised.seen.note_command(command, t_s)
        return True

    def _limitings(self, supervised: SupervisedVehicle, t_s: float) -> list[Output]:
        if supervised.meter is None or not supervised.meter.notes:
            return []
        notes, supervised.meter.notes = supervised.meter.notes, []
        return [
            self._event(t_s, "limited", supervised.name, f"{supervised.name}: {n}") for n in notes
        ]

    def _drop(
        self, supervised: SupervisedVehicle, frame: MavlinkFrame, t_s: float, what: str = ""
    ) -> Outputs:
        """Count a frame that is not forwarded; report the first of its kind, of the first kinds."""
        key = (supervised.name, what or frame_name(frame))
        if key not in self.dropped and len(self.dropped) >= _MOST_DROPPED:
            return ()
        self.dropped[key] = self.dropped.get(key, 0) + 1
        if self.dropped[key] > 1:
            return ()
        return (self._event(t_s, "dropped", supervised.name, f"{key[1]} was not forwarded"),)

    def _latch(self, cause: Cause, name: str, text: str, t_s: float) -> list[Output]:
        """Latch the guard: take over and report the cause; a later cause is only reported.

        Of a vehicle that lands alone only that one is taken over, except when clocks diverge.
        """
        about = self._supervised_vehicles.get(name)
        if about is not None and about.vehicle.lands_alone and cause != "clock":
            return self._land_alone(about, cause, text, t_s)
        if self.latched is not None:
            return self._report_once(about, cause, text, t_s)
        self.latched, self.paused = cause, False
        out: list[Output] = []
        for supervised in self._supervised_vehicles.values():
            actions = supervised.contingency.start(supervised.seen.facts(t_s), t_s)
            out += self._send(supervised, actions, t_s)
        # Frames that brake the vehicles are sent first; events follow.
        return [*out, *self._report_once(about, cause, text, t_s)]

    def _land_alone(
        self, supervised: SupervisedVehicle, cause: Cause, text: str, t_s: float
    ) -> list[Output]:
        actions = supervised.contingency.start(supervised.seen.facts(t_s), t_s)
        out = [*self._send(supervised, actions, t_s)]
        if cause not in supervised.reported:
            supervised.reported.add(cause)
            out.append(self._event(t_s, "alone", supervised.name, text))
        return out

    def _report_once(
        self, supervised: SupervisedVehicle | None, kind: EventKind, text: str, t_s: float
    ) -> list[Output]:
        if supervised is None:
            reported, name = self._reported_of_all, ""
        else:
            reported, name = supervised.reported, supervised.name
        if kind in reported:
            return []
        reported.add(kind)
        return [self._event(t_s, kind, name, text)]

    def _send(
        self, supervised: SupervisedVehicle, actions: list[ContingencyAction], t_s: float
    ) -> list[Output]:
        frames = [supervised.frame(action, t_s) for action in actions]
        beat_s = supervised.heartbeat_s
        if beat_s is None or t_s - beat_s >= self.settings.heartbeat_s - 1e-9:
            supervised.heartbeat_s = t_s
            frames.append(supervised.codec.pack(own_heartbeat()))
        out: list[Output] = [ToVehicle(supervised.name, tuple(frames))] if frames else []
        return [*out, *self._notes_of(supervised, t_s)]

    def _notes(self, t_s: float) -> list[Output]:
        return [
            event
            for supervised in self._supervised_vehicles.values()
            for event in self._notes_of(supervised, t_s)
        ]

    def _notes_of(self, supervised: SupervisedVehicle, t_s: float) -> list[Output]:
        notes, supervised.contingency.notes = supervised.contingency.notes, []
        return [
            self._event(t_s, "action", supervised.name, f"{supervised.name}: {n}") for n in notes
        ]

    @staticmethod
    def _event(t_s: float, kind: EventKind, name: str, text: str) -> GuardEvent:
        return GuardEvent(t_s, kind, name, text)
