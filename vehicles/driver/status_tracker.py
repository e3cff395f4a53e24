"""Tracks the vehicle's modes, states and STATUSTEXTs, and reports their changes as events."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.autopilots.autopilot import Autopilot, Mode
from vehicles.driver.session.conditions import ConditionWaiter
from vehicles.driver.session.session import Session
from vehicles.driver.session.statustext import StatustextPieces
from vehicles.driver.vehicle_state import (
    LANDED_STATES,
    Battery,
    EventKind,
    Landed,
    ReportName,
    StatusText,
    VehicleEvent,
    VehicleState,
)
from vehicles.mavlink.names import enum_name
from vehicles.tasks import Contained

EventListener = Callable[[VehicleEvent], None]

_MAX_TEXTS = 20
_ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
_FAILSAFE_STATES = frozenset(
    {
        mavlink.MAV_STATE_CRITICAL,
        mavlink.MAV_STATE_EMERGENCY,
        mavlink.MAV_STATE_FLIGHT_TERMINATION,
    }
)
_UNKNOWN_VOLTAGE_MV = 0xFFFF


class StatusTracker:
    """Tracks the autopilot's reported status in `state`; reports changes to listeners.

    Listeners are called in the loop's turn in which a message came; what they raise goes to the
    loop's exception handler. state: without estimates and time of arrival, which change too
    often to be kept there.
    """

    def __init__(
        self,
        *,
        session: Session,
        autopilot: Autopilot,
        changes: ConditionWaiter,
        listeners: Sequence[EventListener],
    ) -> None:
        self._autopilot = autopilot
        self._changes = changes
        self._listeners = listeners
        self._pieces = StatustextPieces()
        self._texts: deque[StatusText] = deque(maxlen=_MAX_TEXTS)
        self.state = VehicleState(link_up=True)
        self.readiness = autopilot.readiness()
        self.reported_s: dict[ReportName, float] = {}
        """When each report of its state last arrived (run clock)."""
        self._was_sound = False
        self.requested_modes: tuple[Mode, ...] = ()
        """The modes that follow from our last command."""
        for message_id, handler in (
            (mavlink.MAVLINK_MSG_ID_HEARTBEAT, self.heartbeat),
            (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, self._on_extended_state),
            (mavlink.MAVLINK_MSG_ID_SYS_STATUS, self._on_sys_status),
            (mavlink.MAVLINK_MSG_ID_STATUSTEXT, self._on_statustext),
            (mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS, self._on_estimator_flags),
            (mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT, self._on_estimator_flags),
            (mavlink.MAVLINK_MSG_ID_HOME_POSITION, self._on_home),
        ):
            session.on(message_id, handler)

    def report(self, event: VehicleEvent) -> None:
        """Report an event to all listeners of the status."""
        for listener in self._listeners:
            with Contained(f"a listener to a vehicle ({event.kind})"):
                listener(event)

    def set_link(self, *, up: bool, t_s: float, gap_s: float) -> None:
        """Set whether the link is up, after nothing was received for `gap_s`."""
        self._change(link_up=up)
        if up:
            text = f"received again after {gap_s:.1f} s"
            self.report(VehicleEvent(t_s, "link_back", text, duration_s=gap_s))
        else:
            self.report(VehicleEvent(t_s, "link_lost", f"nothing received for {gap_s:.1f} s"))

    def rebooted(self, t_s: float) -> None:
        """Reset the status of readiness: the vehicle rebooted."""
        self.readiness = self._autopilot.readiness()
        self._was_sound = False
        self._change(faults=())
        self.report(VehicleEvent(t_s, "reboot", "the vehicle's clock restarted (it rebooted)"))

    def last_texts(self, count: int = 5) -> tuple[str, ...]:
        """Return the last STATUSTEXTs, oldest first; each once."""
        distinct = dict.fromkeys(text.text for text in reversed(self._texts))
        return tuple(reversed(list(distinct)[:count]))

    def _change(self, **fields: Any) -> None:
        self.state = self.state._replace(**fields)
        self._changes.notify()

    def heartbeat(self, message: Any, t_s: float) -> None:
        """Update the status by a HEARTBEAT."""
        before = self.state
        self.reported_s["heartbeat"] = t_s
        mode = self._autopilot.mode_of(message.custom_mode)
        armed = bool(message.base_mode & _ARMED)
        failsafe = message.system_status in _FAILSAFE_STATES
        now = before._replace(
            armed=armed,
            mode=mode,
            mode_name=self._autopilot.mode_name(message.custom_mode),
            custom_mode=message.custom_mode,
            system_status=message.system_status,
            failsafe=failsafe,
        )
        self.readiness.feed(message)
        if now == before:
            self._changes.notify()
            return
        self.state = now
        if before.custom_mode != now.custom_mode:
            by_itself = not armed and self._autopilot.changes_mode_on_disarm
            asked = mode in self.requested_modes or by_itself
            self.report(VehicleEvent(t_s, "mode", now.mode_name, mode=mode, asked=asked))
        if before.armed != armed and before.custom_mode is not None:
            self.report(VehicleEvent(t_s, "armed" if armed else "disarmed", now.mode_name))
        if before.failsafe != failsafe:
            kind: EventKind = "failsafe" if failsafe else "failsafe_over"
            self.report(VehicleEvent(t_s, kind, enum_name("MAV_STATE", message.system_status)))
        self._changes.notify()

    def _on_extended_state(self, message: Any, t_s: float) -> None:
        self.readiness.feed(message)
        self.reported_s["landed_state"] = t_s
        landed_state = message.landed_state
        known = landed_state < len(LANDED_STATES)
        landed: Landed = LANDED_STATES[landed_state] if known else "unknown"
        if landed != self.state.landed:
            self.state = self.state._replace(landed=landed)
            self.report(VehicleEvent(t_s, "landed_state", landed))
        self._changes.notify()

    def _on_sys_status(self, message: Any, t_s: float) -> None:
        self.readiness.feed(message)
        voltage_mv, percent = message.voltage_battery, message.battery_remaining
        battery = Battery(
            voltage_v=None if voltage_mv == _UNKNOWN_VOLTAGE_MV else voltage_mv * 1e-3,
            remaining=None if percent < 0 else percent / 100.0,
        )
        if battery.voltage_v is not None or battery.remaining is not None:
            self.reported_s["battery"] = t_s
        self._change(battery=battery)

    def _on_statustext(self, message: Any, t_s: float) -> None:
        whole = self._pieces.add(message.text, message.id, message.chunk_seq)
        if not whole:
            return
        self._texts.append(StatusText(t_s, message.severity, whole))
        self._change(texts=tuple(self._texts))
        self.report(VehicleEvent(t_s, "text", whole, severity=message.severity))

    def _on_estimator_flags(self, message: Any, t_s: float) -> None:
        self.readiness.feed(message)
        self.reported_s["estimator"] = t_s
        faults = self.readiness.estimator_faults()
        before = self.state.faults
        if faults != before:
            self.state = self.state._replace(faults=faults)
            if self._was_sound:
                kind: EventKind = "fault" if faults else "fault_over"
                self.report(VehicleEvent(t_s, kind, ", ".join(faults or before)))
        # While an estimator starts, all its flags are missing: that is no fault yet.
        self._was_sound = self._was_sound or not faults
        self._changes.notify()

    def _on_home(self, message: Any, _t_s: float) -> None:
        self.readiness.feed(message)
        self._changes.notify()
