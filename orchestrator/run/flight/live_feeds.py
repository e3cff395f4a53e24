"""The live feeds of a run: what raises in one ends it, and never the flight."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Self

from wil_campaign.foundation.tasks import FAULTS
from wil_campaign.installed_plugins import plugin_at_fault, plugin_of_module, whose_fault_text
from wil_campaign.orchestrator.run.flight.run_feed import RunFeed
from wil_campaign.orchestrator.run.judging.oracle_runner import OracleRunner
from wil_campaign.orchestrator.run.perception.perception import Perception
from wil_campaign.orchestrator.state.mixtures import PreviewImages
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.guard.core.events import GuardEvent
from wil_campaign.safety.model.oracle_results import Flag

Make = Callable[..., RunFeed]
"""Makes a feed; the keyword `note` receives the reason when it ends early."""


class LiveFeeds(AbstractContextManager["LiveFeeds", None]):
    """The live feeds of one run; a context manager.

    makers: by name of the view what makes its feed. log: receives why a feed has ended early. One
    that raises, even as it is made, is closed and told nothing more.
    """

    def __init__(
        self, makers: Mapping[str, Make], run_state: RunState, log: Callable[[str], None]
    ) -> None:
        self._makers = makers
        self._log = log
        self._feeds: dict[str, RunFeed] = {}
        self._ended: list[str] = []
        run_state.on_stage(lambda stage, t_s: self._tell(lambda feed: feed.stage(stage, t_s)))
        run_state.on_decisive(lambda event: self._tell(lambda feed: feed.decisive(event)))

    def __enter__(self) -> Self:
        for name, make in self._makers.items():
            try:
                feed = make(note=self._note)
                feed.__enter__()
            except (*FAULTS, SystemExit) as error:
                self._fail(name, error)
            else:
                self._feeds[name] = feed
        return self

    def __exit__(self, *_: object) -> None:
        for name in tuple(self._feeds):
            self._close(name)

    @property
    def ended(self) -> tuple[str, ...]:
        """Return which live views ended early, and why."""
        return tuple(self._ended)

    def attach(
        self,
        contexts: Sequence[VehicleContext],
        oracle_runner: OracleRunner,
        perception: Perception,
    ) -> None:
        """Publish the state of vehicles, oracles and perception from now on."""
        self._tell(lambda feed: feed.attach(contexts, oracle_runner, perception))
        for context in contexts:
            self._follow(context)

    def tick(self) -> None:
        """Publish the run's state if a view waits for it; called twenty times a second."""
        self._tell(lambda feed: feed.tick())

    def shown(self, images: PreviewImages) -> None:
        """Publish a perceived image and the images it was mixed from."""
        self._tell(lambda feed: feed.shown(images))

    def flag(self, flag: Flag) -> None:
        """Publish an oracle's flag."""
        self._tell(lambda feed: feed.flag(flag))

    def guard(self, event: GuardEvent) -> None:
        """Publish an event of the guard."""
        self._tell(lambda feed: feed.guard(event))

    def _follow(self, context: VehicleContext) -> None:
        name = context.name
        context.driver.on_event(
            lambda event: self._tell(lambda feed: feed.vehicle_event(name, event))
        )

    def _tell(self, call: Callable[[RunFeed], None]) -> None:
        for name, feed in tuple(self._feeds.items()):
            try:
                call(feed)
            except (*FAULTS, SystemExit) as error:
                self._fail(name, error, feed)
                self._close(name)

    def _close(self, name: str) -> None:
        feed = self._feeds.pop(name, None)
        try:
            if feed is not None:
                feed.__exit__(None, None, None)
        except (*FAULTS, SystemExit) as error:
            self._fail(name, error, feed)

    def _fail(self, name: str, error: BaseException, feed: RunFeed | None = None) -> None:
        plugin = plugin_at_fault(error) or plugin_of_module(type(feed).__module__)
        whose = whose_fault_text(plugin)
        self._note(f"{name}: {type(error).__name__}: {error}{whose}")

    def _note(self, text: str) -> None:
        self._ended.append(text)
        self._log(text)
