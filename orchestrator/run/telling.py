"""What a run tells to the outside while it flies: where it stands, and what happens, at once."""

import asyncio
from collections.abc import Callable, Iterable, Mapping

from campaigns.expansion import RunPlan
from orchestrator.progress import Happening, HappeningKind, Progress, Report, VehicleProgress
from orchestrator.run.course import Course, Stage
from orchestrator.run.station import Station
from orchestrator.run.statistics import MixingStatistics
from safety.guard.events import GuardEvent
from safety.guard.operator_command import OperatorCommand
from safety.results import Flag
from safety.verdict import DecisiveEvent

PROGRESS_S = 0.5


class Telling:
    """Reports one run; `course` is followed from the start."""

    def __init__(
        self,
        *,
        plan: RunPlan,
        report: Report,
        course: Course,
        kinds: Mapping[str, str],
    ) -> None:
        self._plan = plan
        self._report = report
        self._course = course
        self._kinds = kinds
        course.on_stage(self._stage)
        course.on_decisive(self._decisive)

    def flag(self, flag: Flag) -> None:
        """Tell of a contact."""
        if self._kinds.get(flag.oracle) == "collision":
            self._tell("collision", flag.oracle, flag.vehicle, flag.text, flag.t_s)

    def guard(self, event: GuardEvent) -> None:
        """Tell what the guard does."""
        self._tell("guard", event.kind, event.vehicle, event.text, event.t_s)

    def answer(self, command: OperatorCommand, ok: bool, text: str) -> None:
        """Tell what came of an operator's command."""
        self._report(
            Happening(
                run=self._plan.name,
                t_s=asyncio.get_running_loop().time(),
                kind="answer",
                word="ok" if ok else "refused",
                vehicle="",
                text=text,
                command_id=command.command_id,
                who=command.who,
            )
        )

    async def follow(
        self,
        stations: Iterable[Station],
        mixing: Callable[[], MixingStatistics | None],
        clearance_m: Callable[[float], float | None],
    ) -> None:
        """Report where all stand, twice a second until cancelled."""
        loop = asyncio.get_running_loop()
        course, plan, flown = self._course, self._plan, tuple(stations)
        while True:
            statistics = mixing()
            self._report(
                Progress(
                    case=plan.case,
                    mode=plan.mode,
                    repetition=plan.repetition,
                    stage=course.stage,
                    t_s=loop.time(),
                    mixing_rate_hz=None if statistics is None else statistics.rate_hz,
                    skew_ms=None if statistics is None else statistics.skew_ms.last,
                    clearance_m=clearance_m(loop.time()),
                    verdict_so_far=course.decisive[0].kind if course.decisive else "PASS",
                    vehicles=tuple(_vehicle(station) for station in flown),
                )
            )
            await asyncio.sleep(PROGRESS_S)

    def _stage(self, stage: Stage, t_s: float) -> None:
        self._tell("stage", stage, "", "", t_s)

    def _decisive(self, event: DecisiveEvent) -> None:
        self._tell("decisive", event.kind, "", event.text, event.t_s)

    def _tell(self, kind: HappeningKind, word: str, vehicle: str, text: str, t_s: float) -> None:
        self._report(
            Happening(
                run=self._plan.name, t_s=t_s, kind=kind, word=word, vehicle=vehicle, text=text
            )
        )


def _vehicle(station: Station) -> VehicleProgress:
    state, newest = station.driver.state, station.poses.latest()
    return VehicleProgress(
        name=station.name,
        armed=state.armed,
        mode=state.mode_name,
        landed=state.landed,
        position_ned_m=None if newest.pose is None else newest.pose.position_ned_m,
        velocity_ned_m_s=None if state.estimate is None else state.estimate.velocity_ned_m_s,
        battery_fraction=None if state.battery is None else state.battery.remaining,
    )
