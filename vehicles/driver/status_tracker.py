"""Tracks the vehicle's modes, states and STATUSTEXTs, and reports their changes as events."""

import asyncio
import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.tasks import SuppressedErrors
from wil_campaign.vehicles.autopilots.autopilot import Autopilot, FlightMode
from wil_campaign.vehicles.driver.session.conditions import ConditionWaiter
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.driver.session.statustext import StatustextPieces, WholeStatustext
from wil_campaign.vehicles.driver.vehicle_state import (
    LANDED_STATES,
    BatteryState,
    EventKind,
    Landed,
    ReportName,
    StatusText,
    VehicleEvent,
    VehicleState,
)
from wil_campaign.vehicles.mavlink.names import enum_name

EventListener = Callable[[VehicleEvent], None]

_MAX_TEXTS = 20
_TEXT_WITHIN_S = 1.0
"""How long the end of a STATUSTEXT is waited for."""
_ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
_FAILSAFE_STATES = frozenset(
    {
        mavlink.MAV_STATE_CRITICAL,
        mavlink.MAV_STATE_EMERGENCY,
        mavlink.MAV_STATE_FLIGHT_TERMINATION,
    }
)
_UNMEASURED_MV = frozenset({0, 0xFFFF})
"""Without a power module ArduPilot sends 0 mV, and PX4 UINT16_MAX; no battery of 0 V flies."""


class StatusTracker:
    """Tracks the autopilot's reported status in `state`; reports changes to listeners.

    Listeners are called in the loop's turn in which a message came; what they raise goes to the
    loop's exception handler. state: without estimates and time of arrival, which change too
    often to be kept there.
    """

    def __init__(
        self,
        *,
        session: MavlinkSession,
        autopilot: Autopilot,
        changes: ConditionWaiter,
        listeners: Sequence[EventListener],
    ) -> None:
        self._autopilot = autopilot
        self._changes = changes
        self._listeners = listeners
        self._pieces = StatustextPieces()
        self._text_timer: asyncio.TimerHandle | None = None
        self._texts: deque[StatusText] = deque(maxlen=_MAX_TEXTS)
        self.state = VehicleState(link_up=True)
        self.readiness = autopilot.readiness()
        self._losses = autopilot.estimator_losses()
        self.reported_s: dict[ReportName, float] = {}
        """When each report of its state last arrived (run clock)."""
        self._was_sound = False
        self._resets: int | None = None
        self.requested_modes: tuple[FlightMode, ...] = ()
        """The modes that follow from our last command."""
        for message_id, handler in (
            (mavlink.MAVLINK_MSG_ID_HEARTBEAT, self.heartbeat),
            (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, self._on_extended_state),
            (mavlink.MAVLINK_MSG_ID_SYS_STATUS, self._on_sys_status),
            (mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS, self._on_estimator_flags),
            (mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT, self._on_estimator_flags),
            (mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, self._on_gps),
            (mavlink.MAVLINK_MSG_ID_GPS2_RAW, self._on_gps),
            (mavlink.MAVLINK_MSG_ID_HOME_POSITION, self._on_home),
            (mavlink.MAVLINK_MSG_ID_ODOMETRY, self._on_odometry),
        ):
            session.on(message_id, handler)
        session.on_payload(mavlink.MAVLINK_MSG_ID_STATUSTEXT, self._on_statustext)

    def stop(self) -> None:
        """Stop waiting for the end of a STATUSTEXT."""
        if self._text_timer is not None:
            self._text_timer.cancel()

    def report(self, event: VehicleEvent) -> None:
        """Report an event to all listeners of the status."""
        for listener in self._listeners:
            with SuppressedErrors(f"a listener to a vehicle ({event.kind})"):
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
        self._losses = self._autopilot.estimator_losses()
        self._was_sound = False
        self._change(faults=(), position_losses=())
        self.report(VehicleEvent(t_s, "reboot", "the vehicle's clock restarted (it rebooted)"))

    def last_texts(self, count: int = 5) -> tuple[str, ...]:
        """Return the last STATUSTEXTs, oldest first; each once. One may not be complete yet."""
        unfinished = self._pieces.unfinished
        texts = [*(text.text for text in self._texts), *([unfinished.text] if unfinished else [])]
        distinct = dict.fromkeys(reversed(texts))
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
        self._losses.arm(armed=armed)
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
        # Of 0 mV, 0 % is nothing measured either.
        without_charge = percent < 0 or (percent == 0 and voltage_mv == 0)
        battery = BatteryState(
            voltage_v=None if voltage_mv in _UNMEASURED_MV else voltage_mv / 1000.0,
            remaining=None if without_charge else percent / 100.0,
        )
        if battery.voltage_v is not None or battery.remaining is not None:
            self.reported_s["battery"] = t_s
        self._change(battery=battery)

    def _on_statustext(self, payload: bytes, t_s: float) -> None:
        self._receive_texts(self._pieces.add(payload, t_s))
        self.stop()
        if self._pieces.unfinished is not None:
            loop = asyncio.get_running_loop()
            self._text_timer = loop.call_later(_TEXT_WITHIN_S, self._end_text)
            self._changes.notify()

    def _end_text(self) -> None:
        self._receive_texts(self._pieces.expire(math.inf))

    def _receive_texts(self, whole: Sequence[WholeStatustext]) -> None:
        for whole_text in whole:
            self._texts.append(StatusText(whole_text.t_s, whole_text.severity, whole_text.text))
            self._change(texts=tuple(self._texts))
            self.report(
                VehicleEvent(whole_text.t_s, "text", whole_text.text, severity=whole_text.severity)
            )

    def _on_estimator_flags(self, message: Any, t_s: float) -> None:
        self.readiness.feed(message)
        self.reported_s["estimator"] = t_s
        self._losses.feed(message)
        self._judge_estimator(t_s)
        self._changes.notify()

    def _on_gps(self, message: Any, t_s: float) -> None:
        self._losses.feed(message)
        if "estimator" in self.reported_s:
            self._judge_estimator(t_s)

    def _judge_estimator(self, t_s: float) -> None:
        """Update the faults of the estimator, and report what is new."""
        lost, before = self._losses.lost, self.state
        faults = (*self.readiness.estimator_faults(), *lost.others)
        self.state = before._replace(faults=faults, position_losses=lost.position)
        was, now = before.faults + before.position_losses, faults + lost.position
        if was != now and self._was_sound:
            kind: EventKind = "fault" if now else "fault_over"
            self.report(VehicleEvent(t_s, kind, ", ".join(now or was)))
        # While an estimator starts, all its flags are missing: that is no fault yet.
        self._was_sound = self._was_sound or not faults

    def _on_home(self, message: Any, _t_s: float) -> None:
        self.readiness.feed(message)
        self._changes.notify()

    def _on_odometry(self, message: Any, t_s: float) -> None:
        before, self._resets = self._resets, message.reset_counter
        if before is not None and before != message.reset_counter and self.state.armed:
            text = f"its estimator was reset (ODOMETRY reset_counter {before} to {self._resets})"
            self.report(VehicleEvent(t_s, "estimator_reset", text))
