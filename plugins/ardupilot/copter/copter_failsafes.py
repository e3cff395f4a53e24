"""ArduCopter's failsafes: their causes, and the actions that its parameters select.

Sources: ArduCopter/events.cpp, ArduCopter/fence.cpp, AP_BattMonitor (4.7); parameters by name.
"""

import math
from typing import NamedTuple

from wil_campaign.plugins.ardupilot.copter.copter_modes import CopterMode
from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import ParameterTable
from wil_campaign.vehicles.embedded.physics.battery import BatteryCharge

_R, _L, _B, _S = CopterMode.RTL, CopterMode.LAND, CopterMode.BRAKE, CopterMode.SMART_RTL
_GCS_ACTIONS = {1: _R, 2: _R, 3: _S, 4: _S, 5: _L, 6: _R, 7: _B}
"""FS_GCS_ENABLE; 6 is RTL for a mission without a landing sequence, as ours are."""
_CONTINUE_WITHOUT_GCS = 1 << 4
"""FS_OPTIONS: GCS_CONTINUE_IF_PILOT_CONTROL."""
_BATTERY_ACTIONS = {1: _L, 2: _R, 3: _S, 4: _S, 6: _R, 7: _B}
"""BATT_FS_LOW_ACT, BATT_FS_CRT_ACT."""
_LOW_FOR_S = 10.0
"""BATT_LOW_TIMER: how long a voltage must be low."""
_FENCE_ACTIONS = {1: _R, 2: _L, 3: _S, 4: _B, 5: _S}
"""FENCE_ACTION; 0 only reports."""


class CopterFailsafeInputs(NamedTuple):
    """The inputs of ArduCopter's failsafes; the age of the GCS heartbeat in s.

    automatic: it is on the ground, or in a mode that mode.h calls an autopilot's.
    """

    t_s: float
    gcs_age_s: float
    automatic: bool
    charge: BatteryCharge
    broken_fences: tuple[str, ...]


class CopterFailsafeDecision(NamedTuple):
    """ArduCopter's failsafe decision: warnings, and the mode to enter; None to keep the mode."""

    texts: tuple[str, ...]
    mode: CopterMode | None


class CopterFailsafes:
    """ArduCopter's failsafes: one decision per cause; an ended cause may begin again.

    That of a battery does not end before the next boot: it does not arm again.
    """

    def __init__(self, parameters: ParameterTable) -> None:
        self._p = parameters
        self._active: set[str] = set()
        self._low_since_s: dict[str, float] = {}

    @property
    def triggered(self) -> bool:
        """Return whether the HEARTBEAT says so: a fence does not (any_failsafe_triggered)."""
        return bool(self._active - {"fence"})

    @property
    def has_low_battery(self) -> bool:
        """Return whether a battery has failed since the boot."""
        return any("battery" in cause for cause in self._active)

    def reset(self) -> None:
        """Forget the failsafe causes that do not last: ArduCopter was armed."""
        self._active = {cause for cause in self._active if "battery" in cause}

    def check(self, view: CopterFailsafeInputs) -> CopterFailsafeDecision | None:
        """Return the ArduCopter failsafe to begin now; None when there is no new cause."""
        causes = self._causes(view)
        ended = {cause for cause in self._active - causes.keys() if "battery" not in cause}
        self._active -= ended
        if "gcs" in ended:
            return CopterFailsafeDecision(("GCS Failsafe Cleared",), None)
        for cause, decision in causes.items():
            if cause not in self._active:
                self._active.add(cause)
                return decision
        return None

    def _causes(self, view: CopterFailsafeInputs) -> dict[str, CopterFailsafeDecision]:
        p = self._p
        causes: dict[str, CopterFailsafeDecision] = {}
        gcs_action = _GCS_ACTIONS.get(int(p["FS_GCS_ENABLE"]))
        if gcs_action and p["FS_GCS_TIMEOUT"] < view.gcs_age_s < math.inf:
            causes["gcs"] = CopterFailsafeDecision(("GCS Failsafe",), gcs_action)
            if not view.automatic and int(p["FS_OPTIONS"]) & _CONTINUE_WITHOUT_GCS:
                text = "GCS Failsafe - Continuing Pilot Control"
                causes["gcs"] = CopterFailsafeDecision((text,), None)
        charge = view.charge
        for level, word in (("CRT", "critical"), ("LOW", "low")):
            if self._is_low(charge, level, view.t_s):
                mode = _BATTERY_ACTIONS.get(int(p[f"BATT_FS_{level}_ACT"]))
                text = (
                    f"Battery 1 is {word} {charge.voltage_v:.2f}V "
                    f"used {charge.consumed_mah:.0f} mAh"
                )
                causes[f"battery {word}"] = CopterFailsafeDecision((text, "Battery Failsafe"), mode)
        if view.broken_fences:
            mode = _FENCE_ACTIONS.get(int(p["FENCE_ACTION"]))
            text = f"{' and '.join(view.broken_fences)} fence breached"
            causes["fence"] = CopterFailsafeDecision((text,), mode)
        return causes

    def _is_low(self, charge: BatteryCharge, level: str, t_s: float) -> bool:
        volts, reserve_mah = self._p[f"BATT_{level}_VOLT"], self._p[f"BATT_{level}_MAH"]
        left_mah = charge.remaining * self._p["BATT_CAPACITY"]
        if charge.voltage_v >= volts:
            self._low_since_s.pop(level, None)
        since_s = self._low_since_s.setdefault(level, t_s) if charge.voltage_v < volts else t_s
        return t_s - since_s > _LOW_FOR_S or left_mah < reserve_mah
