"""Between runs: an attached vehicle flies back to its start, or a person moves it."""

import itertools
import json
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

from wil_campaign.campaigns.expansion.expansion import Campaign, RunPlan
from wil_campaign.campaigns.schema.between_runs import BetweenRunsPart
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.return_path import (
    CLEAR_M,
    ReturnPath,
    offset_from_start_text,
    read_standing_pose,
    why_no_return,
    why_path_blocked,
)
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.worlds.clearance.clearance import ClearanceProbe
from wil_campaign.worlds.frames import Pose

_BACK = "back"
"""The folder beneath a campaign's with the return flights, each under its run's name.

A run that was flown again (`--again`) has a further one in `<rep>-2`, and so on.
"""


class AskPerson(Protocol):
    """Asks a person to move a vehicle back to its start between runs (protocol)."""

    def ask(self, elsewhere: str = "") -> None:
        """Hold the campaign between runs, and show what the person has to do.

        elsewhere: in words, the start of the next run where it is another one.
        """


class BetweenRuns:
    """Returns an attached vehicle to its start between two runs; for an actor a person is asked.

    hardware: in words, the vehicles that are no simulation; a person is asked to move them where
    the campaign file says nothing about it.
    """

    def __init__(
        self,
        *,
        campaign: Campaign,
        folder: Path,
        hardware: str,
        repositioning: AskPerson,
        say: Callable[[str], None],
    ) -> None:
        self._campaign = campaign
        self._folder = folder
        self._hardware = hardware
        self._repositioning = repositioning
        self._say = say

    def after(
        self,
        order: RunOrder,
        result: RunResult,
        *,
        coming: Iterable[RunPlan] = (),
        flown: bool = True,
    ) -> RunOrder | None:
        """Return the return flight after a run; None where there is none.

        coming: the runs that are still to be flown, in their order; only a person moves a vehicle
        to another start. flown: whether it may have flown; else it stands at its start.
        """
        setup, plan = self._campaign.setups[order.plan.case], order.plan
        if not self._moved_in(plan):
            return None
        wanted, elsewhere = self._campaign.between, self._start_elsewhere(plan, coming)
        if wanted is None or wanted.do == "ask":
            if (flown or elsewhere) and (wanted is not None or self._hardware):
                self._repositioning.ask(elsewhere)
            return None
        back: RunOrder | str | None = None
        if elsewhere:
            back = f"the next run starts elsewhere, at {elsewhere}"
        elif flown:
            back = self._return_order(order, result, setup, wanted)
        if not isinstance(back, str):
            return back
        self._say(f"{plan.name}: the vehicle does not fly back: {back}")
        self._repositioning.ask(elsewhere)
        return None

    def _moved_in(self, plan: RunPlan) -> dict[str, Pose]:
        """Return the starts of a run's vehicles that a person or a flight back moves, by name."""
        flown = self._campaign.setups[plan.case].flown_in(plan.mode)
        return {one.name: one.start for one in flown if one.attached and one.name != "twin"}

    def _start_elsewhere(self, plan: RunPlan, coming: Iterable[RunPlan]) -> str:
        """Return in words where vehicles of a run start in the next one; empty for the same."""
        begun = self._moved_in(plan)
        following = next((moved for one in coming if (moved := self._moved_in(one))), {})
        return " and ".join(
            f"{_place_text(start)} for {name}"
            for name, start in following.items()
            if name in begun and begun[name] != start
        )

    def check_return(self, order: RunOrder, outcome: RunResult | WorkerLost) -> None:
        """Check a vehicle's position after its return flight; ask a person if it is off."""
        wanted, back = self._campaign.between, order.back
        if wanted is None or back is None:
            return
        why = ""
        if isinstance(outcome, WorkerLost):
            why = f"the flight was lost: {outcome.reason}"
        elif outcome.verdict != "PASS":
            why = f"{outcome.verdict}, {outcome.reason}"
        else:
            off = offset_from_start_text(read_standing_pose(order.folder, "real"), back.start)
            if off is None:
                why = "its position is unknown"
            elif off[0] > wanted.tolerance_m or off[1] > wanted.tolerance_deg:
                why = f"it is {off[0]:.2f} m and {off[1]:.0f} degrees off"
            else:
                self._say(f"real is back at its start, {off[0]:.2f} m and {off[1]:.0f} degrees off")
        if why:
            self._say(f"real is not back at its start: {why}")
            self._repositioning.ask()

    def _return_order(
        self, order: RunOrder, result: RunResult, case: Case, wanted: BetweenRunsPart
    ) -> RunOrder | str | None:
        """Return the return flight; None if it is at its start already, or in words why not."""
        start, stand = case.vehicles["real"].start, read_standing_pose(order.folder, "real")
        scene = case.world.scene(order.plan.mode, "W")
        log = _log_lines(order.folder / "log.jsonl")
        if why := why_no_return(result, stand, log, solid=set(scene.names)):
            return why
        off = offset_from_start_text(stand, start)
        if stand is None or off is None:
            return "its position is unknown"
        if off[0] <= wanted.tolerance_m and off[1] <= wanted.tolerance_deg:
            return None
        altitude_m = case.goal.altitude_m
        if wanted.height_m is not None:
            altitude_m = wanted.height_m - start.position_ned_m[2]
        way = ReturnPath(
            stand=stand.pose, start=start, altitude_m=altitude_m, speed_m_s=wanted.speed_m_s
        )
        probe = ClearanceProbe(scene, case.vehicles["real"].body, floors=False, within_m=CLEAR_M)
        fence = case.fences.get("real")
        if why := why_path_blocked(way, fence=fence, keep_m=case.guarding.keep_m, probe=probe):
            return why
        folder = _unused_folder(self._folder / _BACK / order.plan.name)
        return replace(order, back=way, folder=folder, attempts=())


def _place_text(start: Pose) -> str:
    north_m, east_m, down_m = start.position_ned_m
    return (
        f"north {north_m:g} m, east {east_m:g} m, up {0.0 - down_m:g} m, heading "
        f"{math.degrees(start.yaw_rad):.0f} degrees"
    )


def _unused_folder(folder: Path) -> Path:
    """Return a folder, or the first `<folder>-2`, `<folder>-3` ... that does not exist."""
    names = (folder.with_name(f"{folder.name}-{number}") for number in itertools.count(2))
    return next(path for path in itertools.chain([folder], names) if not path.exists())


def _log_lines(path: Path) -> Iterator[dict[str, Any]]:
    with path.open(encoding="utf-8") as file:
        for line in file:
            if line.endswith("\n"):
                yield json.loads(line)
