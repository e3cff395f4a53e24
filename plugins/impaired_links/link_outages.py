"""Outages of a run's links at the stages that the campaign names."""

import asyncio
from collections.abc import Coroutine, Iterable, Iterator, Mapping
from functools import partial
from typing import Any

from wil_campaign.orchestrator.state.observer import Observer
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.plugins.impaired_links.link_setups import (
    ImpairedLinks,
    LinkSetup,
    StageOutage,
)
from wil_campaign.safety.guard.core.commands import StartOutage
from wil_campaign.safety.guard.guard import Guard
from wil_campaign.safety.model.verdict import NEVER_BEGAN


class LinkOutages(Observer):
    """Has the guard start the outages of the links to the pair."""

    def __init__(self, links: ImpairedLinks) -> None:
        self._links = links.links
        self._guard: Guard
        self._names: tuple[str, ...] = ()
        self._begun: set[tuple[str, StageOutage]] = set()

    def attach(self, contexts: Iterable[VehicleContext]) -> None:
        """Attach the vehicles that fly."""
        self._names = tuple(context.name for context in contexts)

    def attach_guard(self, guard: Guard) -> None:
        """Attach the guard, which has the links."""
        self._guard = guard

    def tasks(self, run_state: RunState, /) -> Iterator[tuple[str, Coroutine[Any, Any, None]]]:
        """Wait for the stages of outages; no task is needed."""
        run_state.on_stage(partial(self._start_outages, run_state))
        yield from ()

    def _outages(self) -> Iterator[tuple[str, StageOutage]]:
        """Yield the outages of the vehicles that fly, each with its vehicle."""
        for name in self._names:
            yield from ((name, outage) for outage in self._links.get(name, LinkSetup()).outages)

    def _start_outages(self, run_state: RunState, stage: Stage, _: float) -> None:
        if stage == "end":
            self._require_all(run_state)
        for name, outage in self._outages():
            if outage.stage == stage:
                asyncio.get_running_loop().call_later(outage.after_s, self._start, name, outage)

    def _start(self, name: str, outage: StageOutage) -> None:
        self._begun.add((name, outage))
        self._guard.send(StartOutage(name, outage.for_s))

    def _require_all(self, run_state: RunState) -> None:
        """Decide the run as INVALID where an outage never began: a PASS would claim that it did."""
        never = next(self._never_begun(run_state.time() - run_state.entered_s["start"]), "")
        if never and not run_state.decisive:
            reason = f"a blackout never began: that of the link to {never}"
            run_state.decide("INVALID", reason, source=NEVER_BEGAN, ends_flight=False)

    def _never_begun(self, open_s: float) -> Iterator[str]:
        """Yield in words the outages that never began. open_s: the longest a link was open."""
        for name, outage in self._outages():
            if (name, outage) not in self._begun:
                yield f"{name} {outage.after_s:g} s after stage {outage.stage}"
        for name in self._names:
            for fixed in self._links.get(name, LinkSetup()).outgoing.outages:
                if fixed.from_s >= open_s:
                    yield f"{name} {fixed.from_s:g} s after its opening"


def observe(_: RunSetup, links: ImpairedLinks, _events: Mapping[str, float]) -> LinkOutages:
    """Return the link outages of a run."""
    return LinkOutages(links)
