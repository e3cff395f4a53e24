"""Injects faults into an embedded vehicle: begins and ends each at its time."""

import asyncio
import copy
from collections.abc import Callable
from typing import Any, TypeVar

from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.faults import (
    FaultKind,
    FaultTextError,
    FaultySignal,
    InjectedFault,
    Restamp,
)

T = TypeVar("T")

_MESSAGES = {
    "pose_source": ("HIL_STATE_QUATERNION", "SIM_STATE"),
    "estimate": (
        *("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "ODOMETRY", "ATTITUDE"),
        *("ATTITUDE_QUATERNION", "ALTITUDE", "VFR_HUD", "AHRS", "AHRS2"),
    ),
}
"""The messages of each signal: the simulator's ground truth, and the autopilot's estimate."""
_TIMES = ("time_boot_ms", "time_usec")


class VehicleFaults:
    """Injects faults into an embedded vehicle and into the messages that it sends.

    kill: called to end the process. report: called with a text at each begin and end.
    """

    def __init__(
        self, vehicle: EmbeddedVehicle, *, kill: Callable[[], None], report: Callable[[str], None]
    ) -> None:
        self._vehicle = vehicle
        self._kill = kill
        self._report = report
        self._active: dict[tuple[str, int], list[InjectedFault]] = {}
        self._signals: dict[str, list[FaultySignal[Any]]] = {}
        self._messages: dict[str, FaultySignal[Any]] = {
            message: self._add(name, FaultySignal(_restamp_message))
            for name, messages in _MESSAGES.items()
            for message in messages
        }
        vehicle.filter_sent(self._pass_message)

    def inject(self, fault: InjectedFault) -> None:
        """Inject a fault after its delay. Raises FaultError for an absent signal."""
        if fault.kind is not None and fault.name not in self._signals:
            raise FaultTextError(f"{str(fault)!r}: this vehicle has no {fault.name}")
        if fault.after_s == 0.0:
            self._begin(fault)
        else:
            asyncio.get_running_loop().call_later(fault.after_s, self._begin, fault)

    def through(
        self, name: str, restamp: Restamp[T], callback: Callable[[T], None]
    ) -> Callable[[T], None]:
        """Return a callback that passes a signal on as its faults change it."""
        signal: FaultySignal[T] = self._add(name, FaultySignal(restamp))

        def pass_on(value: T) -> None:
            passed = signal.passed(value)
            if passed is not None:
                callback(passed)

        return pass_on

    def _add(self, name: str, signal: FaultySignal[T]) -> FaultySignal[T]:
        self._signals.setdefault(name, []).append(signal)
        return signal

    def _begin(self, fault: InjectedFault) -> None:
        self._report(f"fault begun: {fault}")
        active = self._active.setdefault(_target(fault), [])
        if fault.name == "unmute":
            active.clear()
        else:
            active.append(fault)
        self._set(fault, fault.kind, begun=True)
        if fault.for_s is not None:
            asyncio.get_running_loop().call_later(fault.for_s, self._end, fault)

    def _end(self, fault: InjectedFault) -> None:
        self._report(f"fault ended: {fault}")
        active = self._active[_target(fault)]
        others = [each for each in active if each is not fault]
        if len(others) == len(active):
            return  # An unmute has ended it.
        active[:] = others
        if others:
            self._set(others[-1], others[-1].kind, begun=True)
        else:
            self._set(fault, None, begun=False)

    def _set(self, fault: InjectedFault, kind: FaultKind | None, *, begun: bool) -> None:
        match fault.name:
            case "kill":
                self._kill()
            case "mute" | "unmute":
                self._vehicle.mute(muted=begun and fault.name == "mute")
            case "motor":
                self._vehicle.fail_motor(fault.motor, factor=fault.factor if begun else 1.0)
            case _:
                for signal in self._signals[fault.name]:
                    signal.fault = kind

    def _pass_message(self, message: Any) -> Any | None:
        signal = self._messages.get(message.get_type())
        return message if signal is None else signal.passed(message)


def _target(fault: InjectedFault) -> tuple[str, int]:
    """Return what a fault acts on: a signal, a motor, or the link."""
    return ("mute" if fault.name == "unmute" else fault.name, fault.motor)


def _restamp_message(last: Any, new: Any) -> Any:
    """Return a MAVLink message with the times of another."""
    restamped = copy.copy(last)
    for name in _TIMES:
        if hasattr(new, name):
            setattr(restamped, name, getattr(new, name))
    return restamped
