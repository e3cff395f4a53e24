"""Plays a finished run as a live feed; the page pauses it, sets its speed and its time."""

import asyncio
from bisect import bisect_right
from collections.abc import Awaitable, Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from wil_campaign.orchestrator.reading.judged_motion import read_judged_motion
from wil_campaign.orchestrator.reading.model import CommandedState
from wil_campaign.orchestrator.reading.trajectory_file import read_trajectory
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.judge_log_file import FILE_NAME as JUDGED
from wil_campaign.orchestrator.recording.recorded_images import NotDrawnAgainError
from wil_campaign.orchestrator.recording.recording_facts import fences_in
from wil_campaign.orchestrator.report.model import LogEvent
from wil_campaign.orchestrator.report.reading.event_log import read_event_log
from wil_campaign.orchestrator.run_results.control_results import expected_text
from wil_campaign.orchestrator.run_results.result_reader import ResultError, read_result
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.console.feed.feed_images import image_view
from wil_campaign.plugins.console.feed.feed_messages import (
    EventView,
    FactsView,
    FeedMessage,
    MarginView,
    RunView,
    VehicleView,
    flown_poses,
)
from wil_campaign.plugins.console.playback import Playback
from wil_campaign.plugins.python.mcap_reader import RecordedReading, Recording
from wil_campaign.safety.evaluation.judge_log import JudgeLogError, read_judge_log
from wil_campaign.safety.fence.fence_values import plain_fence
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import StateSample
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.worlds.frames import Vec3
from wil_campaign.worlds.scene.track import RunHistory

_VIEW_S = 0.1
_IMAGE_S = 1.0 / 15.0
_AGAIN_S = 5.0
"""Pause at the end before the run is played again."""

Take = Callable[[FeedMessage], Awaitable[None]]


@dataclass(frozen=True, slots=True)
class _Loaded:
    """The small files of a run's folder, in memory. states: by vehicle, in order of time."""

    rows: tuple[CommandedState, ...]
    events: tuple[EventView, ...]
    stages: Mapping[str, float]
    result: RunResult | None
    history: RunHistory
    states: Mapping[str, list[StateSample]]

    def state(self, vehicle: str, t_s: float) -> StateSample | None:
        """Return the newest state that a vehicle had reported at a time."""
        states = self.states.get(vehicle, [])
        number = bisect_right(states, t_s, key=lambda one: one.t_s)
        return states[number - 1] if number else None

    def trails(self, until_s: float) -> dict[str, list[Vec3]]:
        """Return the positions of each vehicle before a time, ten per second."""
        found: dict[str, list[Vec3]] = {}
        for t_s, rows in _moments(self.rows):
            for row in rows if t_s < until_s else ():
                if (place := row.truth_ned_m or row.position_ned_m) is not None:
                    found.setdefault(row.vehicle, []).append(place)
        return found

    def margins(self, t_s: float) -> tuple[MarginView, ...]:
        """Return the oracles' final values, each from the time at which it was reached."""
        if self.result is None:
            return ()
        is_over = t_s >= self.rows[-1].t_s
        return tuple(
            MarginView.of(oracle, has_failed=oracle.verdict == "FAIL")
            if is_over or _is_known(oracle, t_s)
            else MarginView.of(_open(oracle), has_failed=False)
            for oracle in self.result.oracles
        )


class RecordedRun:
    """A finished run, played in a loop. playback: its pause, speed and time."""

    def __init__(self, folder: Path, playback: Playback) -> None:
        self._playback = playback
        self._folder = folder.absolute()
        self._run = str(self._folder)
        self._fences: dict[str, object] = {}

    async def play(self, take: Take) -> None:
        """Play the run until cancelled. Raises RecordingError, OSError."""
        loaded = await asyncio.to_thread(self._load)
        if not loaded.rows:
            raise RecordingError(f"{self._folder / 'trajectory.csv'} has no row that can be read")
        self._playback.begin(loaded.rows[0].t_s, loaded.rows[-1].t_s)
        while True:
            from_s = self._playback.t_s
            if await self._play_from(loaded, take, from_s):
                await self._playback.wait_at_end(_AGAIN_S)
                self._playback.restart()

    async def _play_from(self, loaded: _Loaded, take: Take, from_s: float) -> bool:
        """Play from a time to the end; return whether it was reached before a jump in time."""
        playback, number = self._playback, 0
        refused: list[NotDrawnAgainError] = []
        recording = Recording(self._folder / "run.mcap", not_drawn=refused.append)
        images = _images(recording)
        image = await asyncio.to_thread(next, images, None)
        facts = dict(recording.facts)
        self._fences = _plain_fences(facts)
        await take(FactsView(self._run, facts))
        is_named = await self._name_refused(refused, loaded, loaded.rows[0].t_s, take)
        if from_s > loaded.rows[0].t_s:
            playback.show_past(self._run, loaded.trails(from_s))
        shown: dict[str, float] = {}
        due: dict[str, CameraReading] = {}
        is_shown = False
        for t_s, rows in _moments(loaded.rows):
            is_before = t_s < min(from_s, loaded.rows[-1].t_s)
            # The first view is shown at once, also of a run that is paused.
            if is_shown and not await playback.reach(t_s):
                return False
            if is_before:
                continue
            while number < len(loaded.events) and loaded.events[number].t_s <= t_s:
                await take(loaded.events[number])
                number += 1
            await take(self._view(loaded, t_s, rows))
            if not is_shown:
                image = await asyncio.to_thread(_skip, images, image, t_s, due)
            is_shown = True
            while image is not None and image.arrived_s <= t_s:
                due[image.source] = image
                image = await asyncio.to_thread(next, images, None)
                await self._show_images(due, shown, take)
            await self._show_images(due, shown, take)
            is_named = is_named or await self._name_refused(refused, loaded, t_s, take)
        return True

    async def _name_refused(
        self, refused: list[NotDrawnAgainError], loaded: _Loaded, t_s: float, take: Take
    ) -> bool:
        """Name the first image that cannot be drawn again, if any; return whether there is."""
        for error in refused[:1]:
            number = len(loaded.events) + 1
            await take(EventView(self._run, number, t_s, "recording", "", "", str(error)))
        return bool(refused)

    async def _show_images(
        self, due: dict[str, CameraReading], shown: dict[str, float], take: Take
    ) -> None:
        """Show the newest image of each source, at most 15 per second of the run."""
        for source, image in tuple(due.items()):
            del due[source]
            if image.arrived_s - shown.get(source, -1.0) >= _IMAGE_S:
                shown[source] = image.arrived_s
                view = await asyncio.to_thread(
                    image_view, self._run, source, image, image.arrived_s
                )
                await take(view)

    def _load(self) -> _Loaded:
        """Return the small files of the run's folder."""
        rows = tuple(row.decoded() for row in read_trajectory(self._folder / "trajectory.csv").rows)
        log = read_event_log(self._folder / "log.jsonl")
        try:
            result = read_result(self._folder / "result.json")
        except ResultError:
            result = None
        events = tuple(
            _event(self._run, number, event) for number, event in enumerate(log.events, start=1)
        )
        history = read_judged_motion(self._folder / JUDGED).world_events
        states = _states(self._folder / JUDGED)
        return _Loaded(rows, events, dict(log.stages), result, history, states)

    def _view(self, loaded: _Loaded, t_s: float, rows: tuple[CommandedState, ...]) -> RunView:
        result, is_over = loaded.result, t_s >= loaded.rows[-1].t_s
        entered_s = {name: at_s for name, at_s in loaded.stages.items() if at_s <= t_s}
        is_known = is_over and result is not None
        return RunView(
            run=self._run,
            name="/".join(self._folder.parts[-3:]),
            clock="recorded",
            subject="twin" if self._folder.parent.name == "sim" else "real",
            t_s=t_s,
            stage=rows[-1].stage,
            entered_s=entered_s,
            events=entered_s,
            verdict_so_far=result.verdict if is_known and result else "",
            reason=_reason(result) if is_known and result else "",
            held=False,
            vehicles=tuple(_vehicle(row, loaded.state(row.vehicle, t_s)) for row in rows),
            margins=loaded.margins(t_s),
            mixings=(),
            fences=self._fences,
            flown=flown_poses(loaded.history, t_s),
        )


def _reason(result: RunResult) -> str:
    """Return the reason of a verdict; of a control, how it must end, and whether it did."""
    if result.control is None:
        return result.reason
    how = "as it must" if result.control.met else "NOT met"
    text = f"a control, {how}: it must {expected_text(result.control)}"
    return f"{text}; {result.reason}" if result.reason else text


def _is_known(result: OracleResult, t_s: float) -> bool:
    """Return whether an oracle had its final value at a time of the run."""
    return result.at_s is not None and result.at_s <= t_s


def _open(result: OracleResult) -> OracleResult:
    """Return an oracle's result before its worst value was reached."""
    later = "its worst value is reached later" if result.actual is not None else ""
    return replace(result, verdict="PASS", actual=None, margin=None, detail=later)


def _event(run: str, number: int, line: LogEvent) -> EventView:
    """Return a line of the log as an event; a stage is its word, as in the live feed."""
    is_stage = line.kind == "stage"
    word, text = (line.text, "") if is_stage else ("", line.text)
    return EventView(run, number, line.t_s, line.kind, word, line.subject, text)


def _states(judged: Path) -> dict[str, list[StateSample]]:
    """Return the reported states by vehicle, as far as the judge log is readable."""
    found: dict[str, list[StateSample]] = {}
    try:
        with judged.open("rb") as stream:
            for sample in read_judge_log(stream):
                if isinstance(sample, StateSample):
                    found.setdefault(sample.vehicle, []).append(sample)
    except (OSError, JudgeLogError):
        pass  # The page says "unknown" where nothing is known.
    return found


def _moments(
    rows: tuple[CommandedState, ...],
) -> Iterator[tuple[float, tuple[CommandedState, ...]]]:
    """Yield the newest row of each vehicle, ten times per second of the run and at its end."""
    newest: dict[str, CommandedState] = {}
    due_s = rows[0].t_s
    for row in rows:
        if row.t_s > due_s and newest:
            yield due_s, tuple(newest.values())
            due_s = max(due_s + _VIEW_S, row.t_s)
        newest[row.vehicle] = row
    yield rows[-1].t_s, tuple(newest.values())


def _images(recording: Recording) -> Iterator[CameraReading]:
    """Yield the recorded images of the first camera, in order of delivery."""
    sensor = ""
    for item in recording:
        if isinstance(item, RecordedReading) and isinstance(item.reading, CameraReading):
            sensor = sensor or item.sensor
            if item.sensor == sensor:
                yield item.reading


def _skip(
    images: Iterator[CameraReading],
    image: CameraReading | None,
    until_s: float,
    due: dict[str, CameraReading],
) -> CameraReading | None:
    """Return the first image after a time; `due` gets the newest before it of each source."""
    while image is not None and image.arrived_s <= until_s:
        due[image.source] = image
        image = next(images, None)
    return image


def _plain_fences(facts: Mapping[str, str]) -> dict[str, object]:
    try:
        return {name: plain_fence(fence) for name, fence in fences_in(facts).items()}
    except (ValueError, KeyError, TypeError):
        return {}  # The scene reports the problem.


def _vehicle(row: CommandedState, state: StateSample | None) -> VehicleView:
    landed = None if state is None else state.landed
    return VehicleView(
        name=row.vehicle,
        armed=row.is_armed,
        mode=row.mode,
        landed="" if landed is None else "on_ground" if landed else "in_air",
        link_up=True,
        failsafe=False,
        silent_s=0.0,
        battery_fraction=None if state is None else state.battery_fraction,
        battery_v=None if state is None else state.battery_v,
        faults=() if state is None or state.estimator_fault is None else (state.estimator_fault,),
        position_ned_m=row.truth_ned_m or row.position_ned_m,
        velocity_ned_m_s=row.velocity_ned_m_s,
        estimate_ned_m=row.position_ned_m,
        setpoint_kind=row.setpoint_kind,
        setpoint=row.setpoint,
        note=row.note,
    )
