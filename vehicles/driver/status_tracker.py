"""The vehicle's modes, states and words: kept as a snapshot, their changes told as events."""

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

_TEXTS_KEPT = 20
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
        self._texts: deque[StatusText] = deque(maxlen=_TEXTS_KEPT)
        self.state = VehicleState(link_up=True)
        self.readiness = autopilot.readiness()
        self.reported_s: dict[ReportName, float] = {}
        """When each report of its state last arrived (run clock)."""
        self._was_sound = False
        self.asked_modes: tuple[Mode, ...] = ()
        """In which modes it may now be because we asked for it."""
        for message_id, handler in (
            (mavlink.MAVLINK_MSG_ID_HEARTBEAT, self.heartbeat),
            (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, self._on_extended_state),
            (mavlink.MAVLINK_MSG_ID_SYS_STATUS, self._sys_status),
            (mavlink.MAVLINK_MSG_ID_STATUSTEXT, self._text),
            (mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS, self._estimator),
            (mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT, self._estimator),
            (mavlink.MAVLINK_MSG_ID_HOME_POSITION, self._home),
        ):
            session.on(message_id, handler)

    def tell(self, event: VehicleEvent) -> None:
        """Report an event to all listeners of the status."""
        for listener in self._listeners:
            with Contained(f"a listener to a vehicle ({event.kind})"):
                listener(event)

    def set_link(self, *, up: bool, t_s: float, gap_s: float) -> None:
        """Note in the status that the vehicle fell silent for `gap_s`, or is back."""
        self._change(link_up=up)
        if up:
            text = f"heard again after {gap_s:.1f} s"
            self.tell(VehicleEvent(t_s, "link_back", text, duration_s=gap_s))
        else:
            self.tell(VehicleEvent(t_s, "link_lost", f"nothing heard for {gap_s:.1f} s"))

    def rebooted(self, t_s: float) -> None:
        """Reset the status of readiness: the vehicle rebooted."""
        self.readiness = self._autopilot.readiness()
        self._was_sound = False
        self._change(faults=())
        self.tell(VehicleEvent(t_s, "reboot", "the vehicle's clock restarted (it rebooted)"))

    def last_texts(self, count: int = 5) -> tuple[str, ...]:
        """Return the last STATUSTEXTs, oldest first; each once."""
        said: dict[str, None] = {}
        for text in reversed(self._texts):
            said.setdefault(text.text)
        return tuple(reversed(list(said)[:count]))

    def _change(self, **fields: Any) -> None:
        self.state = self.state._replace(**fields)
        self._changes.notify()

    def _on_status_change(self, message: Any) -> None:
        self.readiness.feed(message)
        self._changes.notify()

    def heartbeat(self, message: Any, t_s: float) -> None:
        """Take a HEARTBEAT into the status, the one of identification included."""
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
            asked = mode in self.asked_modes or by_itself
            self.tell(VehicleEvent(t_s, "mode", now.mode_name, mode=mode, asked=asked))
        if before.armed != armed and before.custom_mode is not None:
            self.tell(VehicleEvent(t_s, "armed" if armed else "disarmed", now.mode_name))
        if before.failsafe != failsafe:
            kind: EventKind = "failsafe" if failsafe else "failsafe_over"
            self.tell(VehicleEvent(t_s, kind, enum_name("MAV_STATE", message.system_status)))
        self._changes.notify()

    def _on_extended_state(self, message: Any, t_s: float) -> None:
        self.readiness.feed(message)
        self.reported_s["landed_state"] = t_s
        landed_state = message.landed_state
        known = landed_state < len(LANDED_STATES)
        landed: Landed = LANDED_STATES[landed_state] if known else "unknown"
        if landed != self.state.landed:
            self.state = self.state._replace(landed=landed)
            self.tell(VehicleEvent(t_s, "landed_state", landed))
        self._changes.notify()

    def _sys_status(self, message: Any, t_s: float) -> None:
        self.readiness.feed(message)
        voltage_mv, percent = message.voltage_battery, message.battery_remaining
        battery = Battery(
            voltage_v=None if voltage_mv == _UNKNOWN_VOLTAGE_MV else voltage_mv * 1e-3,
            remaining=None if percent < 0 else percent / 100.0,
        )
        if battery.voltage_v is not None or battery.remaining is not None:
            self.reported_s["battery"] = t_s
        self._change(battery=battery)

    def _text(self, message: Any, t_s: float) -> None:
        whole = self._pieces.add(message.text, message.id, message.chunk_seq)
        if not whole:
            return
        self._texts.append(StatusText(t_s, message.severity, whole))
        self._change(texts=tuple(self._texts))
        self.tell(VehicleEvent(t_s, "text", whole, severity=message.severity))

    def _estimator(self, message: Any, t_s: float) -> None:
        self.readiness.feed(message)
        self.reported_s["estimator"] = t_s
        faults = self.readiness.estimator_faults()
        before = self.state.faults
        if faults != before:
            self.state = self.state._replace(faults=faults)
            if self._was_sound:
                kind: EventKind = "fault" if faults else "fault_over"
                self.tell(VehicleEvent(t_s, kind, ", ".join(faults or before)))
        # While an estimator starts it lacks everything: that is no fault yet.
        self._was_sound = self._was_sound or not faults
        self._changes.notify()

    def _home(self, message: Any, _t_s: float) -> None:
        self._on_status_change(message)
