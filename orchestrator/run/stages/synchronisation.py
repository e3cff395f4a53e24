"""Synchronisation of a pair: skews of command, takeoff and t0, clocks; against their limits."""

import math
from collections.abc import Iterable, Mapping
from functools import partial

from wil_campaign.campaigns.setup.case_setup import SyncSetup
from wil_campaign.orchestrator.run_results.run_result import SyncResult
from wil_campaign.orchestrator.state.liftoff_detector import LiftoffDetector
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.guard.local_guard import Record
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample
from wil_campaign.vehicles.mavlink.fields import NAV_TAKEOFF, command_in_frame
from wil_campaign.vehicles.mavlink.framing import frame_header
from wil_campaign.worlds.figures import distinct_value_text

_IN_DOUBT_S = 3.0
"""A simulation that stood for a moment is in doubt for the five TIMESYNC that show its new pace."""
_WATCHED_EVERY_S = 0.1


class Synchronisation:
    """Measures the pair's synchronisation: command, takeoff and t0 skew, and their limits.

    max_clock_error_s: the largest doubt of a vehicle's clock in flight.
    """

    def __init__(
        self, *, setup: SyncSetup, run_state: RunState, max_clock_error_s: float = math.inf
    ) -> None:
        self._setup = setup
        self._run_state = run_state
        self._max_clock_error_s = max_clock_error_s
        self._doubted: dict[str, float] = {}
        """Since when a vehicle's clock is in doubt without a pause."""
        self._watched_s: dict[str, float] = {}
        self._decided: set[str] = set()
        self._contexts: tuple[VehicleContext, ...] = ()
        self._command_s: dict[str, float] = {}
        self._goal_s: dict[str, float] = {}
        self._waited_s: Mapping[str, float] = {}

    def attach(self, contexts: tuple[VehicleContext, ...]) -> None:
        """Attach the pair whose synchronisation is measured."""
        self._contexts = contexts
        self._run_state.on_stage(self._on_stage)

    def watch_clocks(self, contexts: Iterable[VehicleContext]) -> None:
        """Watch the clocks of vehicles, by each of their estimates, from takeoff to landing."""
        for context in contexts:
            context.driver.on_estimate(partial(self._watch_clock, context))

    def stagger(self, waited_s: Mapping[str, float]) -> None:
        """Set how long each vehicle's takeoff command is delayed for a common liftoff."""
        self._waited_s = waited_s

    def recording(self, record: Record) -> Record:
        """Return a frame recorder that also notes the pair's takeoff command times."""

        def note(name: str, t_s: float, frame: bytes) -> None:
            record(name, t_s, frame)
            if name not in self._command_s and _is_takeoff(frame):
                self._command_s[name] = t_s

        return note

    def goal_given(self, name: str, t_s: float) -> None:
        """Note when a vehicle got its goal's first setpoint, for the t0 skew."""
        self._goal_s[name] = t_s
        self._check("t0", self.result().t0_skew_s, self._setup.max_t0_skew_s)

    def check_takeoff(self) -> None:
        """Check the pair's takeoff skew against its limits, once both are at height.

        That of the liftoffs counts the doubt of both vehicles' clocks. A skew that was not measured
        makes the run INVALID, too. With a vehicle that dropped out there is no skew to check.
        """
        if any(context.name in self._run_state.dropped_out for context in self._contexts):
            return
        result = self.result()
        lifted = [
            context.name for context in self._contexts if context.liftoff.liftoff_s is not None
        ]
        self._require("command", self._command_s, "takeoff command to")
        due_s = {n: t_s - self._waited_s.get(n, 0.0) for n, t_s in self._command_s.items()}
        self._check("command", self._skew(due_s), self._setup.max_command_skew_s)
        self._require("takeoff", lifted, "liftoff of")
        doubt_s = sum(context.liftoff.doubt_s for context in self._contexts)
        limit_s = self._setup.max_takeoff_skew_s
        self._check("takeoff", result.takeoff_skew_s, limit_s, doubt_s=doubt_s)

    def result(self) -> SyncResult:
        """Return the pair's skews as far as known; None for one vehicle alone."""
        lifts = {context.name: context.liftoff.liftoff_s for context in self._contexts}
        lifted = {name: lifted_s for name, lifted_s in lifts.items() if lifted_s is not None}
        return SyncResult(
            command_skew_s=self._skew(self._command_s),
            takeoff_skew_s=self._skew(lifted),
            t0_skew_s=self._skew(self._goal_s),
            liftoff_delays_s={
                name: lifted[name] - command_s
                for name, command_s in sorted(self._command_s.items())
                if name in lifted
            },
        )

    def _on_stage(self, stage: Stage, _: float) -> None:
        if stage == "land" and self._run_state.reached("done"):
            self._check_goal_given()
        if stage == "takeoff":
            # A drift of the estimate on the ground, before this, was no liftoff.
            for context in self._contexts:
                context.liftoff = LiftoffDetector()

    def _check_goal_given(self) -> None:
        """Check after the goal that the other vehicle was flown, too, where the first one was."""
        flown = [one for one in self._contexts if one.name not in self._run_state.dropped_out]
        if len(flown) == len(self._contexts) and flown and flown[0].name in self._goal_s:
            self._require("t0", self._goal_s, "setpoint to", ends_flight=False)

    def _watch_clock(self, context: VehicleContext, sample: EstimateSample) -> None:
        """Decide that a clock was in doubt for too long: times of what it stamps are not known."""
        name, limit_s, state = context.name, self._max_clock_error_s, self._run_state
        if sample.t_s < self._watched_s.get(name, 0.0) + _WATCHED_EVERY_S:
            return
        self._watched_s[name] = sample.t_s
        doubt_s = context.driver.clock.uncertainty_s or 0.0
        is_flown = state.reached("takeoff") and not state.reached("landed")
        if doubt_s <= limit_s or not is_flown or name in state.dropped_out:
            self._doubted.pop(name, None)
            return
        since_s = self._doubted.setdefault(name, sample.t_s)
        if sample.t_s - since_s < _IN_DOUBT_S or name in self._decided:
            return
        self._decided.add(name)
        most = distinct_value_text(doubt_s, limit_s, digits=3)
        text = f"the clock of {name} is known to {most} s only, for {_IN_DOUBT_S:g} s from "
        text += f"{since_s:.1f} s on; preflight.max_clock_error_s is {limit_s:g} s"
        state.decide("INVALID", text, source="sync/clock", ends_flight=False)

    def _skew(self, times_s: dict[str, float]) -> float | None:
        if len(self._contexts) < 2 or len(times_s) < len(self._contexts):
            return None
        return max(times_s.values()) - min(times_s.values())

    def _require(
        self, what: str, known: Iterable[str], event: str, *, ends_flight: bool = True
    ) -> None:
        missing = [context.name for context in self._contexts if context.name not in set(known)]
        if len(self._contexts) > 1 and missing:
            self._run_state.decide(
                "INVALID",
                f"{what} skew was not measured: no {event} {' and '.join(missing)}",
                source=f"sync/{what}",
                ends_flight=ends_flight,
            )

    def _check(
        self, what: str, skew_s: float | None, limit_s: float, *, doubt_s: float = 0.0
    ) -> None:
        """Check a skew; it may be larger by what the vehicles' clocks are in doubt."""
        if skew_s is None or skew_s + doubt_s <= limit_s:
            return
        text = f"{what} skew "
        if skew_s > limit_s:
            text += f"{distinct_value_text(skew_s, limit_s, digits=3)} s exceeds {limit_s:g} s"
        else:
            most = distinct_value_text(skew_s + doubt_s, limit_s, digits=3)
            text += f"{skew_s:.3f} s may be up to {most} s, for the vehicles' clocks are known to "
            text += f"{doubt_s:.3f} s; the limit is {limit_s:g} s"
        self._run_state.decide("INVALID", text, source=f"sync/{what}")


def _is_takeoff(frame: bytes) -> bool:
    """Return whether a frame is a takeoff command."""
    header = frame_header(frame)
    command = None if header is None else command_in_frame(header)
    return command is not None and command.number == NAV_TAKEOFF
