"""The terms of an oracle: the judged vehicle, whether it is required, its window, fail-fast."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError
from wil_campaign.safety.model.samples import Stage, StageSample

STAGES: tuple[Stage, ...] = get_args(Stage)
"""The stages in the order in which a run reaches them."""

_SINCE: Mapping[Stage, str] = {"goal": "the goal", "takeoff": "the takeoff command"}
"""The stages from which people count, the later one first."""

FirstStage = Literal["takeoff", "at_height", "goal", "done", "land"]
LastStage = Literal["at_height", "goal", "done", "land", "landed", "end"]


@dataclass(frozen=True, slots=True)
class StageWindow:
    """The stages between which an oracle judges: from reaching `first` to reaching `last`.

    If a run is cut short and skips `last`, any later stage closes the window.
    """

    first: FirstStage
    last: LastStage


FLIGHT = StageWindow("takeoff", "landed")
IN_THE_AIR = StageWindow("at_height", "land")
ON_GOAL = StageWindow("goal", "land")


@dataclass(frozen=True, slots=True, kw_only=True)
class OracleTerms:
    """The terms of one oracle in one run: name, vehicle, window, whether required.

    fail_fast: on its decisive flag all vehicles land at once; else the flight continues.
    """

    name: str
    vehicle: str
    required: bool
    window: StageWindow = FLIGHT
    fail_fast: bool = False


class OracleParameters(BaseModel):
    """The parameters that a campaign may give to every oracle.

    vehicle: the judged vehicle; None is the subject of the run (real in wil and real, twin in sim).
    required: whether its FAIL fails the run, or is only reported.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    vehicle: Annotated[
        Literal["real", "twin"] | None,
        Field(description="the vehicle that it judges; by default real, in mode sim the twin"),
    ] = None
    required: Annotated[
        bool, Field(description="whether its FAIL fails the run, or is only reported")
    ] = True


class Windowed(OracleParameters):
    """The parameters of an oracle that judges a window of the flight.

    from, to: the stages that open and close its window; None: the default of its kind. fail_fast:
    land at once when it fails; None: the default of its kind.
    """

    from_: Annotated[
        FirstStage | None, Field(alias="from", description="the stage that opens its window")
    ] = None
    to: Annotated[LastStage | None, Field(description="the stage that closes its window")] = None
    fail_fast: Annotated[
        bool | None, Field(description="lands both vehicles at once when it fails")
    ] = None

    @model_validator(mode="after")
    def _fails_something(self) -> Self:
        """Refuse fail_fast of an oracle that is not required."""
        if self.fail_fast and not self.required:
            raise KeyFaultError(
                "fail_fast", "an oracle that is not required does not end the flight"
            )
        return self

    def window(self, usual: StageWindow) -> StageWindow:
        """Return the oracle's window, `usual` by default. Raises ValueError when empty."""
        first, last = self.from_ or usual.first, self.to or usual.last
        if STAGES.index(first) >= STAGES.index(last):
            raise ValueError(f"its window is empty: '{first}' does not come before '{last}'")
        return StageWindow(first, last)


class StageTracker:
    """The stages reached so far, and whether an oracle's window is open or covers a sample.

    A pose may arrive long after its time: `covers` and `near_ground_at` go by the time of the
    sample, so that how late it arrives changes no verdict. They are called for each pose.
    """

    def __init__(self, window: StageWindow = FLIGHT) -> None:
        self._window = window
        self._closing = frozenset(STAGES[STAGES.index(window.last) :])
        self._at_s: dict[Stage, float] = {}
        self._from_s = self._until_s = math.inf
        self._at_height_s = self._land_s = math.inf
        self.open = False
        """Whether the window is open now."""
        self.near_ground = True
        """Whether the vehicle may be near the ground now: before at_height, and from land on."""

    def reach(self, sample: StageSample) -> None:
        """Record a reached stage; only its first time counts."""
        self._at_s.setdefault(sample.stage, sample.t_s)
        closed = not self._closing.isdisjoint(self._at_s)
        self.open = self._window.first in self._at_s and not closed
        self.near_ground = "at_height" not in self._at_s or "land" in self._at_s
        self._from_s = self._at_s.get(self._window.first, math.inf)
        self._until_s = math.inf if self.end_s is None else self.end_s
        self._at_height_s = self._at_s.get("at_height", math.inf)
        self._land_s = self._at_s.get("land", math.inf)

    def covers(self, t_s: float) -> bool:
        """Return whether the window was open at the time of a sample, however late that arrives."""
        return self._from_s <= t_s < self._until_s

    def near_ground_at(self, t_s: float) -> bool:
        """Return whether the vehicle may have been near the ground at the time of a sample."""
        return t_s < self._at_height_s or t_s >= self._land_s

    def at(self, stage: Stage) -> float | None:
        """Return when a stage was reached, or None."""
        return self._at_s.get(stage)

    def since(self, t_s: float, *, lead: str = " ") -> str:
        """Return how long after the goal, or the takeoff command, a time is; "" before both.

        The run clock's own seconds mean little to people where it is that of the machine.
        """
        for stage, words in _SINCE.items():
            since_s = self._at_s.get(stage)
            if since_s is not None and since_s <= t_s:
                return f"{lead}{t_s - since_s:.2f} s after {words}"
        return ""

    @property
    def begin_s(self) -> float | None:
        """Return when the oracle's window opened, or None."""
        return self._at_s.get(self._window.first)

    @property
    def end_s(self) -> float | None:
        """Return when the oracle's window closed, or None."""
        return min((self._at_s[s] for s in self._closing if s in self._at_s), default=None)
