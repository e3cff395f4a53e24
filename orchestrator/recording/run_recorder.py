"""Records the files of one run: log, trajectory, judge log, telemetry, run.mcap.

How much a recording may lack before its run is INVALID; pure.
"""

import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any, Self

from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.foundation.tasks import TakeFault
from wil_campaign.orchestrator.recording.judge_log_file import FILE_NAME as JUDGED
from wil_campaign.orchestrator.recording.judge_log_file import JudgeLogWriter
from wil_campaign.orchestrator.recording.mcap.mcap_encode import PERCEIVED
from wil_campaign.orchestrator.recording.mcap.mcap_settings import RecordingSettings
from wil_campaign.orchestrator.recording.mcap.mcap_writer import (
    McapRecorder,
    RecordingReport,
    TopicLoss,
)
from wil_campaign.orchestrator.recording.recording_facts import mounts_in
from wil_campaign.orchestrator.recording.trajectory import TrajectoryRow, TrajectoryWriter
from wil_campaign.orchestrator.state.mixtures import MixedFrame, PreviewImages
from wil_campaign.orchestrator.state.run_log import RunLog
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.evaluation.judge_log import LoggedSample
from wil_campaign.safety.guard.core.events import GuardEvent
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.model.oracle_results import Flag
from wil_campaign.safety.model.verdict import DecisiveEvent
from wil_campaign.vehicles.driver.vehicle_state import VehicleEvent
from wil_campaign.vehicles.mavlink.tlog import TlogWriter
from wil_campaign.vehicles.readings import Reading

_EVIDENCE_PARTS = ("/provenance", "/visibility")
"""Parts of /mixed/<sensor> that are evidence for the verdict."""


def excessive_loss(losses: Iterable[TopicLoss], *, max_loss: float) -> str:
    """Return in words what is missing beyond the limit; empty when nothing is.

    max_loss: which share of a topic may be missing. Evidence for the verdict must be complete.
    """
    excessive = [
        f"{loss.lost} of {loss.offered} of {loss.topic}"
        for loss in losses
        if loss.lost > loss.offered * (0.0 if _is_evidence(loss.topic) else max_loss)
    ]
    limit = f"more than {max_loss:.3g} of a topic, or any evidence for the verdict"
    return f"run.mcap lacks {', '.join(excessive)}: {limit}" if excessive else ""


def _is_evidence(topic: str) -> bool:
    return topic.startswith("/mixed/") and topic.endswith(_EVIDENCE_PARTS)


TRAJECTORY_HZ = 20.0


class RunRecorder:
    """Records the streams of one run into `folder`; a context manager.

    epoch_s: UTC of the run clock's zero. vehicles: whose frames are logged. collision_oracles:
    names of those whose flags are contacts. clock: decides whether run.mcap waits for its writer or
    drops messages. settings, facts: of run.mcap. broken: called once with the reason when a file
    cannot be written (the disk is full); later data is dropped. fault: called with internal errors.
    incomplete: called with what run.mcap lacks, in words, where that exceeds max_loss, a share of
    each topic. `artifacts` has the names of the files, `losses` what is missing.
    """

    def __init__(
        self,
        *,
        folder: Path,
        time: Callable[[], float],
        epoch_s: float,
        vehicles: tuple[str, ...],
        collision_oracles: frozenset[str],
        clock: Clock,
        settings: RecordingSettings,
        broken: Callable[[str], None],
        facts: Mapping[str, str],
        fault: TakeFault,
        incomplete: Callable[[str], None],
        max_loss: float,
    ) -> None:
        self._fault = fault
        self._incomplete = incomplete
        self._max_loss = max_loss
        self.losses: tuple[TopicLoss, ...] = ()
        self._folder = folder
        self._time = time
        self._stack = ExitStack()
        self._log = RunLog(path=folder / "log.jsonl")
        self._trajectory = TrajectoryWriter(path=folder / "trajectory.csv")
        self._judged = JudgeLogWriter(path=folder / JUDGED)
        self._tlogs = {
            name: TlogWriter(path=folder / f"{name}.tlog", epoch_s=epoch_s) for name in vehicles
        }
        self._mcap = McapRecorder(
            path=folder / "run.mcap",
            epoch_s=epoch_s,
            clock=clock,
            settings=settings,
            facts=facts,
            mounts=mounts_in(facts),
        )
        self._is_shown = False
        self._collision_oracles = collision_oracles
        self.collisions: list[Flag] = []
        self._broken = broken
        self._is_broken = False

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            streams: tuple[AbstractContextManager[object], ...] = (
                self._log,
                self._trajectory,
                self._judged,
                *self._tlogs.values(),
                self._mcap,
            )
            for stream in streams:
                stack.enter_context(stream)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._report_losses(self._mcap.close())
        finally:
            self._guard_write(self._stack.close)
            self._look_for_removed()
            if not os.access(self._folder, os.W_OK):  # the result has to be written there
                self._break(f"{self._folder} has become read-only")

    def _guard_write(self, write: Callable[..., None], *args: Any, **details: Any) -> None:
        """Call a write function; its failure breaks the recorder, not the flight."""
        try:
            write(*args, **details)
        except OSError as error:
            self._break(error.strerror or str(error))

    def _break(self, why: str) -> None:
        if not self._is_broken:
            self._is_broken = True
            self._broken(f"the recording ended early: {why}")

    def _write_log(self, t_s: float, event: str, **details: str | float | bool | None) -> None:
        self._guard_write(self._log.write, t_s, event, **details)

    def _report_losses(self, report: RecordingReport) -> None:
        """Record what run.mcap lacks, because a replay would not show it."""
        for error in report.errors:
            self._fault(error, "run.mcap")
        if report.complete:
            return
        dropped = ", ".join(f"{count} of {topic}" for topic, count in report.dropped)
        self.note("recording", fault=report.fault, failed=report.failed, dropped=dropped or None)
        self.losses = report.losses
        why = excessive_loss(report.losses, max_loss=self._max_loss)
        if report.fault is not None:
            # A disk that fails takes what was written before with it: the chunk that was not full.
            why = f"{why or 'run.mcap is cut off'} ({report.fault})"
        if report.unfinished:
            why += f"; check the disk of {self._folder}"
        if why:
            self._incomplete(why)

    @property
    def epoch_ns(self) -> int:
        """Return UTC of the run clock's zero as run.mcap has it, nanoseconds since 1970."""
        return self._mcap.epoch_ns

    @property
    def artifacts(self) -> tuple[str, ...]:
        """Return the names of the recorded files in the run's folder, sorted."""
        if not self._folder.is_dir():  # it was removed
            return ()
        return tuple(sorted(path.name for path in self._folder.iterdir()))

    def stage(self, stage: str, t_s: float) -> None:
        """Record that the run reached a stage."""
        self._write_log(t_s, "stage", stage=stage)
        self._mcap.event(t_s, "info", "stage", stage)

    def decisive(self, event: DecisiveEvent) -> None:
        """Record a decisive event of the run."""
        optional = {"note": event.note, "trace": event.trace}
        more = {key: text for key, text in optional.items() if text}
        self._write_log(
            event.t_s, "decisive", kind=event.kind, reason=event.text, source=event.source, **more
        )
        self._mcap.event(event.t_s, "error", event.kind, event.text)

    def flag(self, flag: Flag) -> None:
        """Record an oracle's flag when it is raised."""
        if flag.oracle in self._collision_oracles:
            self.collisions.append(flag)
        self._write_log(flag.t_s, "flag", oracle=flag.oracle, vehicle=flag.vehicle, text=flag.text)
        self._mcap.event(flag.t_s, "warning", flag.oracle, flag.text)

    def guard_event(self, event: GuardEvent) -> None:
        """Record an event of the guard."""
        self._write_log(event.t_s, "guard", kind=event.kind, vehicle=event.vehicle, text=event.text)

    def operator(self, command: OperatorCommand) -> None:
        """Record an operator's command and who gave it."""
        self._write_log(
            self._time(), "operator", kind=command.kind, who=command.who, reason=command.reason
        )

    def vehicle_event(self, name: str, event: VehicleEvent) -> None:
        """Record an event of a vehicle."""
        self._write_log(event.t_s, "vehicle", vehicle=name, kind=event.kind, text=event.text)

    def note(self, event: str, **details: str | float | bool | None) -> None:
        """Record any other event in the run's log."""
        self._write_log(self._time(), event, **details)

    def judged(self, sample: LoggedSample) -> None:
        """Record a sample that the oracles judge."""
        self._guard_write(self._judged.write, sample)

    def frame(self, name: str, t_s: float, frame: bytes) -> None:
        """Record a MAVLink frame that passed the guard."""
        if name in self._tlogs:
            self._guard_write(self._tlogs[name].write, t_s, frame)

    def reading(self, reading: Reading) -> None:
        """Record a reading of real or twin."""
        self._mcap.reading(reading.sensor, reading)

    def mixture(self, frame: MixedFrame) -> None:
        """Record a mixture, or that there was none, with its provenance."""
        mixed = frame.mixed
        self._mcap.mixed(frame.name, mixed.reading, mixed.provenance, now_s=self._time())
        if frame.visibility is not None:
            self._mcap.visibility(frame.name, frame.visibility, now_s=self._time())

    def shown(self, shown: PreviewImages) -> None:
        """Record once which images the judged vehicle's autonomy perceives."""
        if not self._is_shown:
            self._is_shown = True
            self._mcap.event(self._time(), "info", PERCEIVED, shown.topic)

    def images_ended(self, topics: tuple[str, ...]) -> None:
        """Record that these topics have no further images: the autonomies fly no more."""
        now_s, text = self._time(), " ".join(topics)
        self._write_log(now_s, "images_ended", topics=text)
        self._mcap.event(now_s, "info", "images_ended", text)

    async def follow(
        self, contexts: tuple[VehicleContext, ...], run_state: RunState, alive: Callable[[], None]
    ) -> None:
        """Record all vehicles' poses at 20 Hz until cancelled, and once more at the end."""
        t0_s, tick = self._time(), 0
        try:
            while True:
                alive()
                self._record_poses(contexts, run_state)
                tick = max(tick + 1, int((self._time() - t0_s) * TRAJECTORY_HZ))
                await sleep_until(t0_s + tick / TRAJECTORY_HZ)
        finally:
            self._record_poses(contexts, run_state)

    def _record_poses(self, contexts: tuple[VehicleContext, ...], run_state: RunState) -> None:
        now_s = self._time()
        self._look_for_removed()
        for context in contexts:
            self._guard_write(self._trajectory.write, _row(context, run_state.stage, now_s))

    def _look_for_removed(self) -> None:
        """Report files that were removed: what is written into them is lost without an error."""
        if self._log.is_removed or self._trajectory.is_removed:
            self._break(f"{self._folder} was removed or moved")


def _row(context: VehicleContext, stage: str, now_s: float) -> TrajectoryRow:
    state = context.driver.state
    truth = context.truth.latest()
    return TrajectoryRow(
        t_s=now_s,
        vehicle=context.name,
        stage=stage,
        mode=state.mode_name,
        armed=state.armed,
        estimate=None if state.estimate is None else state.estimate.pose,
        velocity_ned_m_s=None if state.estimate is None else state.estimate.velocity_ned_m_s,
        truth=truth.pose,
        setpoint=context.setpoint,
        note=context.note,
    )
