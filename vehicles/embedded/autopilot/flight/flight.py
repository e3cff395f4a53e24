"""A flight from arming to landing: motors, the flown behaviour, takeoff and landing detection."""

import math
from dataclasses import dataclass

from wil_campaign.vehicles.embedded.autopilot.flight.autopilot_state import AutopilotState
from wil_campaign.vehicles.embedded.autopilot.flight.guidance import GuidanceBehaviour
from wil_campaign.vehicles.embedded.control.law import ControlLaw, ControlLawKind, LawGains
from wil_campaign.vehicles.embedded.control.target import ControlTarget
from wil_campaign.vehicles.embedded.physics.airframe import Airframe
from wil_campaign.vehicles.embedded.physics.motion_kernel import NO_LAW
from wil_campaign.vehicles.embedded.physics.states import BodyMotion
from wil_campaign.vehicles.poses.truth import STOPPED, Thrusts
from wil_campaign.worlds.jit import F64

_IDLE_SHARE = 0.08
_LIFT_SHARE = 0.92
"""Shares of hover thrust: armed on the ground, and just before leaving the ground."""


@dataclass(frozen=True, slots=True)
class FlightStyle:
    """The times of arming, liftoff and landing in which the autopilots differ, s.

    spool: from arming until thrust may rise. lift: from then until leaving the ground. noticed:
    from the rise of thrust until the autopilot detects takeoff. touch: how long it touches the
    ground until landing is detected.
    """

    law: ControlLawKind
    spool_s: float
    lift_s: float
    noticed_s: float
    touch_s: float


class Flight:
    """The flight of one armed or disarmed vehicle: motors and motion."""

    def __init__(
        self,
        *,
        style: FlightStyle,
        airframe: Airframe,
        dt_s: float,
        parameters: LawGains,
        law_array: F64 | None = None,
    ) -> None:
        self._style = style
        self._hover_n = airframe.hover_thrust_n
        self._top_n = airframe.max_thrust_n
        self.law = ControlLaw(
            kind=style.law, airframe=airframe, dt_s=dt_s, parameters=parameters, array=law_array
        )
        self.behaviour: GuidanceBehaviour | None = None
        self.armed = False
        self.landed = True
        self.takeoff_detected = False
        """In the air, or thrust has risen enough for the autopilot to detect takeoff."""
        self.armed_at_s = 0.0
        self.landed_at_s: float | None = None
        """Time of the last landing since arming; None before it."""
        self.motors_cut = False
        self.target: ControlTarget | None = None
        """The controller's target; None on the ground."""
        self._lift_began_s: float | None = None
        self._touch_began_s: float | None = None
        self._commanded: Thrusts = STOPPED

    @property
    def throttle(self) -> float:
        """Return the flight's mean commanded thrust, 0 to 1."""
        return sum(self._commanded) / (4.0 * self._top_n)

    def arm(self, t_s: float) -> None:
        """Start the motors, idling."""
        self.armed = True
        self.armed_at_s = t_s
        self.landed_at_s = None
        self._lift_began_s = None

    def disarm(self) -> None:
        """Stop the motors."""
        self.armed = False
        self.takeoff_detected = False
        self._commanded = STOPPED

    def fly(self, behaviour: GuidanceBehaviour) -> None:
        """Fly a behaviour from now on."""
        self.behaviour = behaviour

    def outer_steps(self) -> int:
        """Return with how many outer steps the body can run the law, its estimate unseen.

        NO_LAW where the flight has to see the estimate first.
        """
        behaviour = self.behaviour
        if self.landed or not self.armed or self.motors_cut or behaviour is None:
            return NO_LAW
        return self.law.outer_steps(behaviour.steady)

    def step(self, state: AutopilotState, *, flown: bool) -> Thrusts:
        """Return the thrusts of this flight step, by the state's estimate and clock.

        flown: the step of the body has run the law already, as `outer_steps` said.
        """
        t_s, touching = state.clock_s, state.touching
        if not self.armed or self.motors_cut or self.behaviour is None:
            self._commanded = STOPPED
            self.target = None
            if touching and not self.landed:
                self._land(t_s)
            return STOPPED
        if self.landed:
            self.target = None
            thrusts = self._on_ground(self.behaviour, state.now, t_s)
        else:
            target = self.target
            if target is None or (self.law.takes_target and not flown):
                self.target = target = self.behaviour.update(state.now, t_s)
            thrusts = self.law.run(state.estimate, target, flown=flown)
            if touching or self._touch_began_s is not None:
                self._detect_landing(self.behaviour, t_s, touching=touching)
        self._commanded = thrusts
        return thrusts

    def _on_ground(self, behaviour: GuidanceBehaviour, now: BodyMotion, t_s: float) -> Thrusts:
        """Idle on the ground; raise thrust to liftoff once a behaviour lifts."""
        style = self._style
        share = _IDLE_SHARE
        if behaviour.lifts and t_s >= self.armed_at_s + style.spool_s:
            if self._lift_began_s is None:
                self._lift_began_s = t_s
            rising_s = t_s - self._lift_began_s
            self.takeoff_detected = rising_s >= style.noticed_s
            if rising_s >= style.lift_s:
                self._leave_ground(now)
            share = _IDLE_SHARE + (_LIFT_SHARE - _IDLE_SHARE) * min(1.0, rising_s / style.lift_s)
        else:
            self._lift_began_s = None
            self.takeoff_detected = False
        thrust_n = share * self._hover_n
        return (thrust_n, thrust_n, thrust_n, thrust_n)

    def _leave_ground(self, now: BodyMotion) -> None:
        self.landed = False
        self.takeoff_detected = True
        self._lift_began_s = None
        self._touch_began_s = None
        self.law.reset(yaw_rad=now.euler_rad[2])

    def _detect_landing(self, behaviour: GuidanceBehaviour, t_s: float, *, touching: bool) -> None:
        if not (touching and behaviour.descends):
            self._touch_began_s = None
        elif self._touch_began_s is None:
            self._touch_began_s = t_s
        elif t_s - self._touch_began_s >= self._style.touch_s:
            self._land(t_s)

    def _land(self, t_s: float) -> None:
        self.landed = True
        self.takeoff_detected = False
        self.landed_at_s = t_s


class TiltWatch:
    """Detects in flight that the body has tumbled: tilted beyond a limit for some time."""

    def __init__(self, *, limit_rad: float, for_s: float) -> None:
        self._cosine = math.cos(limit_rad)
        self._for_s = for_s
        self._since_s: float | None = None

    def tumbling(self, now: BodyMotion, t_s: float) -> bool:
        """Return whether the vehicle tumbles, with this attitude as the next sample."""
        roll, pitch, _ = now.euler_rad
        if math.cos(roll) * math.cos(pitch) >= self._cosine:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = t_s
        return t_s - self._since_s >= self._for_s
