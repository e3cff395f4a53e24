"""PX4's failsafes: their causes, and the actions that its parameters select.

Source: src/modules/commander/failsafe/failsafe.cpp (v1.18); parameters by their names.
"""

import math
from enum import Enum
from typing import NamedTuple

from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import ParameterTable

GCS_SILENT_AFTER_S = 2.5
"""A ground station whose last heartbeat is older counts as gone (HEARTBEAT_TIMEOUT_US of
telemetry_status); COM_DL_LOSS_T begins then."""


class Px4FailsafeAction(Enum):
    """The action of a PX4 failsafe, mildest first."""

    NONE = 0
    WARN = 1
    HOLD = 2
    RETURN = 3
    LAND = 4
    DISARM = 5
    TERMINATE = 6


class Px4FailsafeInputs(NamedTuple):
    """The inputs of PX4's failsafes; ages in s, battery 0 to 1.

    landing: LAND is flown because the user chose it. landed: on the ground.
    """

    t_s: float
    offboard: bool
    landing: bool
    landed: bool
    setpoint_age_s: float
    gcs_age_s: float
    battery: float
    outside_fence: bool


class Px4FailsafeDecision(NamedTuple):
    """PX4's failsafe decision: its cause and its action; a hold before another action lasts."""

    cause: str
    action: Px4FailsafeAction
    hold_s: float = 0.0


_OFFBOARD_LOST = {
    3: Px4FailsafeAction.RETURN,
    4: Px4FailsafeAction.LAND,
    5: Px4FailsafeAction.HOLD,
    6: Px4FailsafeAction.TERMINATE,
    7: Px4FailsafeAction.DISARM,
}
"""COM_OBL_RC_ACT; the manual modes 0 to 2 cannot run without sticks: PX4 returns."""
_LINK_LOST = {
    1: Px4FailsafeAction.HOLD,
    2: Px4FailsafeAction.RETURN,
    3: Px4FailsafeAction.LAND,
    5: Px4FailsafeAction.TERMINATE,
    6: Px4FailsafeAction.DISARM,
}
"""NAV_DLL_ACT."""
_FENCE = {
    1: Px4FailsafeAction.WARN,
    2: Px4FailsafeAction.HOLD,
    3: Px4FailsafeAction.RETURN,
    4: Px4FailsafeAction.TERMINATE,
    5: Px4FailsafeAction.LAND,
}
"""GF_ACTION."""
_DELAYED = {Px4FailsafeAction.RETURN, Px4FailsafeAction.LAND}
_FLOWN = {Px4FailsafeAction.HOLD, Px4FailsafeAction.RETURN, Px4FailsafeAction.LAND}
_AFTER_LIFTOFF = {"link", "fence"}
"""Causes whose flown action waits for the liftoff. A battery as low as at arming does not act
(`_battery_warning_at_arming`)."""


class Px4Failsafes:
    """PX4's failsafes: one decision per cause; an ended cause may begin again."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._p = parameters
        self._active: dict[str, Px4FailsafeAction] = {}
        self._pending: tuple[float, Px4FailsafeDecision] | None = None

    def reset(self) -> None:
        """Forget all failsafe causes: PX4 was armed."""
        self._active.clear()
        self._pending = None

    def on_user_mode(self) -> None:
        """Drop PX4's pending failsafe: the user chose a mode."""
        self._pending = None

    def check(self, view: Px4FailsafeInputs) -> Px4FailsafeDecision | None:
        """Return the PX4 failsafe to begin now; None when there is no new cause."""
        if self._pending is not None and view.t_s >= self._pending[0]:
            decision, self._pending = self._pending[1], None
            return decision
        # Lost setpoints act at once, each time OFFBOARD is flown without them.
        if view.offboard and view.setpoint_age_s > self._p["COM_OF_LOSS_T"]:
            action = _OFFBOARD_LOST.get(int(self._p["COM_OBL_RC_ACT"]), Px4FailsafeAction.RETURN)
            return Px4FailsafeDecision("offboard", action)
        for cause, action in self._causes(view):
            if action is Px4FailsafeAction.NONE:
                self._active.pop(cause, None)
            elif view.landed and action in _FLOWN and cause in _AFTER_LIFTOFF:
                continue
            elif self._active.get(cause) is not action:
                self._active[cause] = action
                return self._begin(Px4FailsafeDecision(cause, action), view.t_s)
        return None

    def _begin(self, decision: Px4FailsafeDecision, t_s: float) -> Px4FailsafeDecision:
        """Hold first for COM_FAIL_ACT_T, so that the user can take over."""
        delay_s = self._p["COM_FAIL_ACT_T"]
        if decision.action not in _DELAYED or delay_s <= 0.0:
            return decision
        self._pending = (t_s + delay_s, decision)
        return Px4FailsafeDecision(decision.cause, Px4FailsafeAction.HOLD, delay_s)

    def _causes(self, view: Px4FailsafeInputs) -> tuple[tuple[str, Px4FailsafeAction], ...]:
        p, link, fence = self._p, Px4FailsafeAction.NONE, Px4FailsafeAction.NONE
        # A landing that the user commanded goes on without the link (dll_loss_ignored_land).
        lost_after_s = p["COM_DL_LOSS_T"] + GCS_SILENT_AFTER_S
        if not view.landing and lost_after_s < view.gcs_age_s < math.inf:
            link = _LINK_LOST.get(int(p["NAV_DLL_ACT"]), Px4FailsafeAction.NONE)
        if view.outside_fence:
            fence = _FENCE.get(int(p["GF_ACTION"]), Px4FailsafeAction.NONE)
        return (("link", link), ("fence", fence), ("battery", self._battery(view.battery)))

    def _battery(self, remaining: float) -> Px4FailsafeAction:
        """Return the action of COM_LOW_BAT_ACT: 0 warns, 2 lands when critical, 3 returns first."""
        p = self._p
        policy = int(p["COM_LOW_BAT_ACT"])
        if remaining < p["BAT_EMERGEN_THR"] and policy in {2, 3}:
            return Px4FailsafeAction.LAND
        if remaining < p["BAT_CRIT_THR"] and policy in {2, 3}:
            return Px4FailsafeAction.LAND if policy == 2 else Px4FailsafeAction.RETURN
        return Px4FailsafeAction.WARN if remaining < p["BAT_LOW_THR"] else Px4FailsafeAction.NONE


WARNINGS = {
    "battery": "Low battery level, return advised\t",
    "fence": "Geofence exceeded\t",
    "link": "Connection to ground control station lost\t",
}
"""The texts of causes that only warn."""
