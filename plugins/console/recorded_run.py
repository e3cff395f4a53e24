"""Plays a finished run as a live feed, at the speed at which it was flown."""

import asyncio
from collections.abc import Awaitable, Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.orchestrator.live_feed.feed_images import image_view
from wil_campaign.orchestrator.live_feed.feed_messages import (
    EventView,
    FactsView,
    FeedMessage,
    MarginView,
    RunView,
    VehicleView,
    flown_poses,
)
from wil_campaign.orchestrator.model.results import RunResult
from wil_campaign.orchestrator.model.results_reader import ResultError, read_result
from wil_campaign.orchestrator.reading.judged_motion import read_judged_motion
from wil_campaign.orchestrator.reading.model import Commanded
from wil_campaign.orchestrator.reading.trajectory_file import read_trajectory
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.judge_log_file import FILE_NAME as JUDGED
from wil_campaign.orchestrator.recording.mcap_reader import RecordedReading, Recording
from wil_campaign.orchestrator.recording.recording_facts import fences_in
from wil_campaign.orchestrator.report.reading.event_log import read_event_log
from wil_campaign.safety.fence.fence_values import plain_fence
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.worlds.scene.track import RunHistory

_VIEW_S = 0.1
_IMAGE_S = 1.0 / 15.0
_AGAIN_S = 5.0
"""Pause at the end before the run is played again."""

Take = Callable[[FeedMessage], Awaitable[None]]


@dataclass(frozen=True, slots=True)
class _Loaded:
    """The small files of a run's folder, in memory."""

    rows: tuple[Commanded, ...]
    events: tuple[EventView, ...]
    stages: Mapping[str, float]
    result: RunResult | None
    history: RunHistory


class RecordedRun:
    """A finished run, played in a loop.

    speed: 1 is real time.
    """

    def __init__(self, folder: Path, *, speed: float = 1.0) -> None:
        self._speed = speed
        self._folder = folder.absolute()
        self._run = str(self._folder)
        self._fences: dict[str, object] = {}

    async def play(self, take: Take) -> None:
        """Play the run until cancelled. Raises RecordingError, OSError."""
        loaded = await asyncio.to_thread(self._load)
        if not loaded.rows:
            raise RecordingError(f"{self._folder / 'trajectory.csv'} has no row that can be read")
        while True:
            await self._play_once(loaded, take)
            await asyncio.sleep(_AGAIN_S)

    async def _play_once(self, loaded: _Loaded, take: Take) -> None:
        loop, first_s = asyncio.get_running_loop(), loaded.rows[0].t_s
        began_s, number = loop.time(), 0
        recording = Recording(self._folder / "run.mcap")
        images = _images(recording)
        image = await asyncio.to_thread(next, images, None)
        facts = dict(recording.facts)
        self._fences = _plain_fences(facts)
        await take(FactsView(self._run, facts))
        views = _moments(loaded.rows)
        shown: dict[str, float] = {}
        for t_s, rows in views:
            await asyncio.sleep(began_s + (t_s - first_s) / self._speed - loop.time())
            while number < len(loaded.events) and loaded.events[number].t_s <= t_s:
                await take(loaded.events[number])
                number += 1
            await take(self._view(loaded, t_s, rows))
            while image is not None and image.arrived_s <= t_s:
                if image.arrived_s - shown.get(image.source, -1.0) >= _IMAGE_S:
                    shown[image.source] = image.arrived_s
                    view = await asyncio.to_thread(
                        image_view, self._run, image.source, image, image.arrived_s
                    )
                    await take(view)
                image = await asyncio.to_thread(next, images, None)

    def _load(self) -> _Loaded:
        """Return the small files of the run's folder."""
        rows = tuple(row.decoded() for row in read_trajectory(self._folder / "trajectory.csv").rows)
        log = read_event_log(self._folder / "log.jsonl")
        try:
            result = read_result(self._folder / "result.json")
        except ResultError:
            result = None
        events = tuple(
            EventView(self._run, number, one.t_s, one.kind, "", one.subject, one.text)
            for number, one in enumerate(log.events, start=1)
        )
        history = read_judged_motion(self._folder / JUDGED).world_events
        return _Loaded(rows, events, dict(log.stages), result, history)

    def _view(self, loaded: _Loaded, t_s: float, rows: tuple[Commanded, ...]) -> RunView:
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
            reason=result.reason if is_known and result else "",
            held=False,
            vehicles=tuple(_vehicle(row) for row in rows),
            margins=_margins(result) if is_known and result else (),
            mixings=(),
            fences=self._fences,
            flown=flown_poses(loaded.history, t_s),
        )


def _moments(rows: tuple[Commanded, ...]) -> Iterator[tuple[float, tuple[Commanded, ...]]]:
    """Yield the newest row of each vehicle, ten times per second of the run and at its end."""
    newest: dict[str, Commanded] = {}
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


def _plain_fences(facts: Mapping[str, str]) -> dict[str, object]:
    try:
        return {name: plain_fence(fence) for name, fence in fences_in(facts).items()}
    except (ValueError, KeyError, TypeError):
        return {}  # The scene reports the problem.


def _vehicle(row: Commanded) -> VehicleView:
    return VehicleView(
        name=row.vehicle,
        armed=row.is_armed,
        mode=row.mode,
        landed="",
        link_up=True,
        failsafe=False,
        silent_s=0.0,
        position_ned_m=row.truth_ned_m or row.position_ned_m,
        velocity_ned_m_s=row.velocity_ned_m_s,
        estimate_ned_m=row.position_ned_m,
        setpoint_kind=row.setpoint_kind,
        setpoint=row.setpoint,
        note=row.note,
    )


def _margins(result: RunResult) -> tuple[MarginView, ...]:
    return tuple(MarginView.of(one) for one in result.oracles)
