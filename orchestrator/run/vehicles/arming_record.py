"""Records the steps before arming, in their order."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from wil_campaign.orchestrator.run_results.result_parts import ArmingStep, StepName

Note = Callable[..., None]


class ArmingRecord:
    """The steps before arming. now: the run clock; note: called with each step, for the log."""

    def __init__(self, *, now: Callable[[], float], note: Note) -> None:
        self._now = now
        self._note = note
        self._steps: list[ArmingStep] = []

    @property
    def steps(self) -> tuple[ArmingStep, ...]:
        """Return the steps so far, oldest first."""
        return tuple(self._steps)

    @contextmanager
    def step(self, name: StepName, vehicle: str = "") -> Iterator[Callable[[str], None]]:
        """Record a step when it ends; yields a function that adds a text to its record."""
        notes: list[str] = []
        try:
            yield notes.append
        except BaseException as error:
            self._add(name, vehicle, ok=False, text=str(error) or type(error).__name__)
            raise
        self._add(name, vehicle, ok=True, text="; ".join(notes))

    def restored(self, vehicle: str, *, ok: bool) -> None:
        """Record whether the onboard configuration of an attached vehicle was restored."""
        self._note("restored", vehicle=vehicle, ok=ok)
        self._steps = [
            replace(arming_step, restored=ok)
            if arming_step.vehicle == vehicle and arming_step.step in {"parameters", "fence"}
            else arming_step
            for arming_step in self._steps
        ]

    def _add(self, name: StepName, vehicle: str, *, ok: bool, text: str) -> None:
        step = ArmingStep(name, vehicle, self._now(), ok, text)
        self._steps.append(step)
        self._note("before_arming", step=name, vehicle=vehicle, ok=ok, text=text)
