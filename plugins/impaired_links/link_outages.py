"""Outages of a run's links at the stages that the campaign names."""

import asyncio
from collections.abc import Coroutine, Iterable, Iterator, Mapping
from typing import Any

from wil_campaign.orchestrator.state.observer import Observer
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.plugins.impaired_links.link_setups import ImpairedLinks
from wil_campaign.safety.guard.core.commands import StartOutage
from wil_campaign.safety.guard.guard import Guard


class LinkOutages(Observer):
    """Has the guard start the outages of the links to the pair."""

    def __init__(self, links: ImpairedLinks) -> None:
        self._links = links.links
        self._guard: Guard
        self._names: tuple[str, ...] = ()

    def attach(self, contexts: Iterable[VehicleContext]) -> None:
        """Attach the vehicles that fly."""
        self._names = tuple(context.name for context in contexts)

    def attach_guard(self, guard: Guard) -> None:
        """Attach the guard, which has the links."""
        self._guard = guard

    def tasks(self, run_state: RunState, /) -> Iterator[tuple[str, Coroutine[Any, Any, None]]]:
        """Wait for the stages of outages; no task is needed."""
        run_state.on_stage(self._start_outages)
        yield from ()

    def _start_outages(self, stage: Stage, _: float) -> None:
        for name in self._names:
            for outage in self._links[name].outages if name in self._links else ():
                if outage.stage == stage:
                    begun = StartOutage(name, outage.for_s)
                    loop = asyncio.get_running_loop()
                    loop.call_later(outage.after_s, self._guard.send, begun)


def observe(_: RunSetup, links: ImpairedLinks, _events: Mapping[str, float]) -> LinkOutages:
    """Return the link outages of a run."""
    return LinkOutages(links)
