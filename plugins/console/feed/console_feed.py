"""The live feed of a run for consoles; it never waits for a console."""

import math
from collections.abc import Sequence
from typing import Self

from wil_campaign.orchestrator.recording.recording_facts import facts_of_run
from wil_campaign.orchestrator.run.flight.run_feed import RunFeed
from wil_campaign.orchestrator.run.judging.oracle_runner import OracleRunner
from wil_campaign.orchestrator.run.perception.mixing_loop import MixingLoop
from wil_campaign.orchestrator.run.perception.perception import Perception
from wil_campaign.orchestrator.state.mixtures import PreviewImages
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.plugins.console.feed.feed_messages import (
    MarginView,
    MixingView,
    RunView,
    VehicleView,
    flown_poses,
)
from wil_campaign.plugins.console.feed.feed_publisher import FeedPublisher, Note
from wil_campaign.safety.fence.fence_values import plain_fence
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.events import GuardEvent
from wil_campaign.safety.model.oracle_results import Flag
from wil_campaign.safety.model.verdict import DecisiveEvent
from wil_campaign.vehicles.driver.vehicle_state import VehicleEvent
from wil_campaign.vehicles.setpoints import PositionSetpoint, Setpoint
from wil_campaign.worlds.frames import Vec3
from wil_campaign.worlds.scene.track import RunHistory


class ConsoleFeed(RunFeed):
    """The live feed of one run, to all consoles of this user."""

    name = "console"

    def __init__(
        self,
        *,
        setup: RunSetup,
        run_state: RunState,
        events: RunHistory,
        epoch_ns: int,
        note: Note,
    ) -> None:
        self._setup = setup
        self._run_state = run_state
        self._events = events
        self._contexts: Sequence[VehicleContext] = ()
        self._oracle_runner: OracleRunner | None = None
        self._perception: Perception | None = None
        self._time = run_state.time
        self._publisher = FeedPublisher(
            run=str(setup.order.folder.absolute()),
            time=self._time,
            facts=lambda: {
                **facts_of_run(setup),
                "epoch_ns": str(epoch_ns),
                "clock": setup.clock,
            },
            note=note,
        )

    def __enter__(self) -> Self:
        self._publisher.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._publisher.__exit__()

    def attach(
        self,
        contexts: Sequence[VehicleContext],
        oracle_runner: OracleRunner,
        perception: Perception,
    ) -> None:
        """Publish the state of vehicles, oracles and perception from now on."""
        self._contexts, self._oracle_runner, self._perception = contexts, oracle_runner, perception

    def tick(self) -> None:
        """Publish the run's state if a console waits for it; called twenty times a second."""
        self._publisher.tick(self._view)

    def shown(self, images: PreviewImages) -> None:
        """Publish a perceived image and the images it was mixed from."""
        self._publisher.images(images)

    def flag(self, flag: Flag) -> None:
        """Publish an oracle's flag."""
        kind = "contact" if self._is_contact(flag) else "flag"
        self._publisher.event(flag.t_s, kind, flag.oracle, flag.text, vehicle=flag.vehicle)

    def guard(self, event: GuardEvent) -> None:
        """Publish an event of the guard."""
        self._publisher.event(event.t_s, "guard", event.kind, event.text, vehicle=event.vehicle)

    def stage(self, stage: Stage, t_s: float) -> None:
        """Publish that the run has entered a stage."""
        self._publisher.event(t_s, "stage", stage, "")

    def decisive(self, event: DecisiveEvent) -> None:
        """Publish an event that decides the run."""
        self._publisher.event(event.t_s, "decisive", event.kind, event.text)

    def vehicle_event(self, name: str, event: VehicleEvent) -> None:
        """Publish an event of a vehicle that flies."""
        self._publisher.event(
            event.t_s, "vehicle", event.kind, event.text, vehicle=name, severity=event.severity
        )

    def _is_contact(self, flag: Flag) -> bool:
        kinds = {} if self._oracle_runner is None else self._oracle_runner.kinds
        return kinds.get(flag.oracle) == "collision"

    def _view(self) -> RunView:
        setup, run_state, now_s = self._setup, self._run_state, self._time()
        first = run_state.decisive[0] if run_state.decisive else None
        oracle_runner, perception = self._oracle_runner, self._perception
        fences: dict[str, Fence] = {str(name): one for name, one in setup.case.fences.items()}
        fences |= {} if oracle_runner is None else oracle_runner.changed_fences
        found = () if oracle_runner is None else oracle_runner.results(now_s)
        margins = tuple(MarginView.of(one, has_failed=failed) for one, failed in found)
        # An oracle that may not end the flight fails without an event.
        failed = next((one for one in margins if one.required and one.has_failed), None)
        failure = ("", "") if failed is None else ("FAIL", _failure_text(failed))
        verdict, reason = failure if first is None else (first.kind, first.text)
        return RunView(
            run=str(setup.order.folder.absolute()),
            name=setup.order.plan.name,
            clock=setup.clock,
            subject=setup.subject,
            t_s=now_s,
            stage=run_state.stage,
            entered_s={str(stage): t_s for stage, t_s in run_state.entered_s.items()},
            events=dict(self._events),
            verdict_so_far=verdict,
            reason=reason,
            held=run_state.held,
            vehicles=tuple(_vehicle_view(context, now_s) for context in self._contexts),
            margins=margins,
            mixings=() if perception is None else tuple(map(_mixing_view, perception.mixings)),
            fences={name: plain_fence(fence) for name, fence in fences.items()},
            flown=flown_poses(self._events, now_s),
        )


def _failure_text(failed: MarginView) -> str:
    return f"{failed.name} of {failed.vehicle} failed: {failed.detail}"


def _vehicle_view(context: VehicleContext, now_s: float) -> VehicleView:
    state = context.driver.state
    pose_t_s, pose = context.poses.sample_before(math.inf) or (None, None)
    estimate, battery = state.estimate, state.battery
    kind, vector = _setpoint(context.setpoint)
    return VehicleView(
        name=context.name,
        armed=state.armed,
        mode=state.mode_name,
        landed=state.landed,
        link_up=state.link_up,
        failsafe=state.failsafe,
        silent_s=None if state.last_received_s is None else now_s - state.last_received_s,
        battery_fraction=None if battery is None else battery.remaining,
        battery_v=None if battery is None else battery.voltage_v,
        faults=state.faults,
        position_ned_m=None if pose is None else pose.position_ned_m,
        q_wxyz=None if pose is None else pose.q_wxyz,
        velocity_ned_m_s=None if estimate is None else estimate.velocity_ned_m_s,
        estimate_ned_m=None if estimate is None else estimate.pose.position_ned_m,
        setpoint_kind=kind,
        setpoint=vector,
        note=context.note,
        pose_t_s=pose_t_s,
    )


def _setpoint(setpoint: Setpoint | None) -> tuple[str, Vec3 | None]:
    if setpoint is None:
        return "", None
    if isinstance(setpoint, PositionSetpoint):
        return "position", setpoint.position_ned_m
    return "velocity", setpoint.velocity_ned_m_s


def _mixing_view(mixing: MixingLoop) -> MixingView:
    statistics = mixing.statistics
    return MixingView(
        name=mixing.name,
        rate_hz=statistics.rate_hz,
        skew_ms=statistics.skew_ms.last,
        latency_ms=statistics.latency_ms.last,
        registration_error_px=statistics.registration_error_px.last,
        missed=statistics.missed,
    )
