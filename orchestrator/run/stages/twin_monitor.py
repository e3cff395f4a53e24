"""Monitors the twin of a run: its distance from the real vehicle, and whether it drops out."""

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from itertools import groupby
from operator import itemgetter

from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.orchestrator.run_results.result_parts import DropOut, TwinResult
from wil_campaign.orchestrator.run_results.run_result import percentiles
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext, is_any_silent
from wil_campaign.vehicles.coupling import Coupling
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.worlds.figures import distinct_value_text
from wil_campaign.worlds.frames import Vec3, norm, subtract

_HZ = 20.0
_DELAY_S = 0.1
"""How long after a time most poses of both vehicles have arrived; a radio may take longer."""
_WAIT_S = 1.5
"""How long to wait for the poses of a time: as long as a vehicle's history has them."""


class TwinMonitor:
    """Measures the distance of real and twin while the goal is flown; beyond the limit: INVALID.

    The run is also INVALID when the distance could not be measured for longer than `max_gap_s`, and
    when the twin drops out while mixtures need readings from the twin's own pose. None of this ends
    the flight.
    """

    def __init__(
        self, *, coupling: Coupling, limit_m: float, max_gap_s: float, run_state: RunState
    ) -> None:
        self._coupling: Coupling = coupling
        self._limit_m = limit_m
        self._max_gap_s = max_gap_s
        self._run_state = run_state
        self._distances_m: list[float] = []
        self._is_beyond = False
        self._waiting: deque[float] = deque()
        self._due: dict[float, bool] = {}
        """Whether the distance was measured, by the times that were due, in order."""
        self._silent: set[float] = set()
        """The times that waited for poses while a vehicle's whole link was silent."""
        self._needed_by: tuple[str, ...] = ()
        self._twin = ""

    def attach(self, twin: str, *, needed_by: Sequence[str]) -> None:
        """Set the twin's name, and the mixtures that need readings from the twin's own pose."""
        self._twin, self._needed_by = twin, tuple(needed_by)
        self._run_state.on_drop_out(self._drop_out)
        self._run_state.on_stage(self._stage)

    async def run(self, contexts: Sequence[VehicleContext], alive: Callable[[], None]) -> None:
        """Measure until the goal is done; run until cancelled. alive: called at each tick."""
        await self._run_state.reaching("goal")
        loop = asyncio.get_running_loop()
        t0_s, count = loop.time(), 0
        while True:
            count += 1
            await sleep_until(t0_s + _DELAY_S + count / _HZ)
            alive()
            if not self._is_over():
                self._due[t0_s + count / _HZ] = False
                self._waiting.append(t0_s + count / _HZ)
            self._measure_waiting(contexts, loop.time())

    def result(self) -> TwinResult:
        """Return what was measured so far."""
        spread = percentiles(self._distances_m)
        return TwinResult(
            coupling=self._coupling,
            distance_p50_m=spread.p50,
            distance_p99_m=spread.p99,
            distance_max_m=max(self._distances_m, default=None),
            limit_m=self._limit_m,
            dropped_out=self._run_state.dropped_out.get(self._twin),
        )

    def _is_over(self) -> bool:
        ended = any(self._run_state.reached(stage) for stage in ("done", "land", "end"))
        return ended or self._twin in self._run_state.dropped_out

    def _measure_waiting(self, contexts: Sequence[VehicleContext], now_s: float) -> None:
        """Measure at the due times of which both poses have arrived by now."""
        for _ in range(len(self._waiting)):
            t_s = self._waiting.popleft()
            real, twin = (self._place(context.poses, t_s) for context in contexts)
            if real is not None and twin is not None:
                self._observe(norm(subtract(real, twin)), t_s)
            elif now_s - t_s < _WAIT_S:
                self._waiting.append(t_s)
        if self._waiting and is_any_silent(contexts, self._run_state.dropped_out, now_s):
            self._silent.update(self._waiting)

    def _place(self, poses: PoseHistory, t_s: float) -> Vec3 | None:
        """Return a vehicle's position at a moment, between poses of an accepted gap at most."""
        at = poses.at(t_s)
        if at.kind == "interpolated" and at.pose is not None:
            return at.pose.position_ned_m
        before, after = poses.sample_before(t_s), poses.sample_after(t_s)
        if before is None or after is None or after[0] - before[0] > self._max_gap_s:
            return None
        share = (t_s - before[0]) / (after[0] - before[0])
        return before[1].interpolate(after[1], share).position_ned_m

    def _observe(self, distance_m: float, t_s: float) -> None:
        self._due[t_s] = True
        self._distances_m.append(distance_m)
        if distance_m <= self._limit_m or self._is_beyond:
            return
        self._is_beyond = True
        self._run_state.decide(
            "INVALID",
            f"real and twin were {distinct_value_text(distance_m, self._limit_m)} m apart; "
            f"sync.max_twin_distance_m is {self._limit_m:g} m",
            t_s=t_s,
            source="sync/twin",
            ends_flight=False,
        )

    def _stage(self, stage: Stage, t_s: float) -> None:
        """Decide at the landing: a distance that was not measured makes the run INVALID.

        It counts from the moment at which a gap exceeds the limit, but for one in which a link was
        silent: that is judged by `link` and by the guard first.
        """
        if stage != "landed" or not self._twin or self._twin in self._run_state.dropped_out:
            return
        from_s, to_s = self._longest_gap()
        if self._due and not self._distances_m:
            what = f"was never measured: at none of {len(self._due)} times were there poses of both"
        elif to_s - from_s > self._max_gap_s:
            is_silence = any(from_s <= silent_s <= to_s for silent_s in self._silent)
            t_s = t_s if is_silence else from_s + self._max_gap_s
            goal_s = self._run_state.entered_s.get("goal", 0.0)
            what = f"was not measured from {from_s - goal_s:.2f} s to {to_s - goal_s:.2f} s after "
            what += (
                f"the goal: there were no poses of both, and a gap may last {self._max_gap_s:g} s"
            )
        else:
            return
        self._run_state.decide(
            "INVALID",
            f"the distance of real and twin {what}; sync.max_twin_distance_m is {self._limit_m:g} "
            "m",
            t_s=t_s,
            source="sync/twin",
            ends_flight=False,
        )

    def _longest_gap(self) -> tuple[float, float]:
        """Return the first and the last time of the longest gap in the measured distances."""
        gaps = [(0.0, 0.0)]
        for measured, each in groupby(self._due.items(), key=itemgetter(1)):
            times_s = [t_s for t_s, _ in each]
            if not measured:
                gaps.append((times_s[0], times_s[-1]))
        return max(gaps, key=lambda gap: gap[1] - gap[0])

    def _drop_out(self, vehicle: str, left: DropOut) -> None:
        if vehicle != self._twin or not self._needed_by or self._run_state.reached("done"):
            return
        self._run_state.decide(
            "INVALID",
            f"the mixture of {' and '.join(self._needed_by)} uses readings from the twin's own "
            f"pose, and the twin dropped out: {left.reason}",
            t_s=left.at_s,
            source="sync/twin",
            ends_flight=False,
        )
