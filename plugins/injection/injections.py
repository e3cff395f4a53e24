"""Injections of one run into its autopilots: checked before arming, and watched in flight."""

import asyncio
from collections.abc import Coroutine, Iterable, Iterator, Mapping
from typing import Any

from wil_campaign.orchestrator.model.external_results import ExternalResult
from wil_campaign.orchestrator.state.observer import Observer
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.plugins.injection.injection_check import InjectionProof, prove_injection
from wil_campaign.plugins.injection.injection_setups import InjectionSetup, InjectionSetups
from wil_campaign.plugins.injection.injector import Injector, ScenePoses
from wil_campaign.vehicles.readings import Reading

_WATCH_S = 0.1


class Injections(Observer):
    """All injections of one run. events: the world's, by time."""

    def __init__(
        self,
        *,
        setup: RunSetup,
        injections: Iterable[InjectionSetup],
        events: Mapping[str, float],
    ) -> None:
        self._setup = setup
        self._injections = tuple(injections)
        self._events = events
        self._contexts: tuple[VehicleContext, ...] = ()
        self._injectors: dict[str, Injector] = {}
        self._proofs: tuple[InjectionProof, ...] = ()

    def attach(self, contexts: Iterable[VehicleContext]) -> None:
        """Attach the vehicles whose autopilots receive injections."""
        setup, self._contexts = self._setup, tuple(contexts)
        scene_poses = ScenePoses(
            setup.virtual_scene if setup.mode != "real" else setup.real_scene,
            setup.campaign.world.frame,
            self._events,
        )
        for context in self._contexts:
            injector = Injector(
                context=context,
                autopilot=setup.vehicle(context.name).autopilot,
                injections=self._injections,
                scene_poses=scene_poses,
            )
            if injector.injections:
                self._injectors[context.name] = injector
                context.on_mocap(injector.pose)

    async def before_arming(self, unbooted: Mapping[str, frozenset[str]], /) -> str:
        """Check that injections are used. Raises UnsupportedInjectionError."""
        if not self._injectors:
            return ""
        vehicles = {str(one.name): one for one in self._setup.vehicles}
        self._proofs = await prove_injection(
            self._contexts, vehicles, self._injections, unbooted=unbooted
        )
        return f"injections into {' and '.join(self._injectors)} are used"

    def tasks(self, run_state: RunState, /) -> Iterator[tuple[str, Coroutine[Any, Any, None]]]:
        """Yield what injects places of objects, and what watches that the autopilots act on it."""
        for name, injector in self._injectors.items():
            yield f"injection into {name}", injector.run()
        if self._injectors:
            yield "injection watch", self._watch(run_state)

    def perceived(self, reading: Reading, by: tuple[str, ...]) -> None:
        """Inject a perceived reading into the autopilots of its receivers."""
        for name in by:
            if name in self._injectors:
                self._injectors[name].perceived(reading.sensor, reading)

    @property
    def result(self) -> ExternalResult:
        """Return the counts of injected messages."""
        return ExternalResult(
            injected=tuple(r for one in self._injectors.values() for r in one.results)
        )

    async def _watch(self, run_state: RunState) -> None:
        """End the flight as INVALID when an autopilot ignores its injections.

        Only after two checks in a row: a mode change may be in progress.
        """
        before = ""
        while True:
            await asyncio.sleep(_WATCH_S)
            problems = ""
            if run_state.stage == "goal" and not run_state.decisive:
                broken = ((proof, proof.broken()) for proof in self._proofs)
                problems = "; ".join(proof.text_of(reasons) for proof, reasons in broken if reasons)
            if problems and problems == before:
                text = f"injection was ignored: {problems}"
                run_state.decide("INVALID", text, source="injection")
                return
            before = problems


def observe(setup: RunSetup, given: InjectionSetups, events: Mapping[str, float]) -> Injections:
    """Return the injections of a run."""
    return Injections(setup=setup, injections=given.injections, events=events)
