"""Whether a vehicle flew through the goal's gates: as a whole, in order and in direction."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.safety.oracles.oracle import (
    NO_FLAGS,
    Flags,
    GateOpening,
    Oracle,
    OracleContext,
    OracleError,
    OracleTerms,
    Windowed,
    oracle,
)
from wil_campaign.safety.oracles.oracle_terms import ON_GOAL
from wil_campaign.safety.oracles.passages import GateDip, GatePassage, PassageDetector, PassingBody
from wil_campaign.worlds.frames import Vec3

Direction = Literal["away", "along", "against", "either"]
"""away: from the side where the vehicle was before; along: the x axis of the gate's object."""
_POINT: Vec3 = (0.0, 0.0, 0.0)


class ReachedParameters(Windowed):
    """gates: to be passed in this order (None: the goal's); direction: which one counts."""

    gates: Annotated[
        tuple[str, ...] | None, Field(description="their names in order; by default the goal's")
    ] = None
    direction: Annotated[
        Direction,
        Field(description="away from where it came, along or against the gate's x axis, or either"),
    ] = "away"


@dataclass(frozen=True, slots=True)
class _Through:
    """A counted passage of `reached`. limit_m: the offset at which the body would touch."""

    gate: str
    offset_m: float
    limit_m: float
    at_s: float


class ReachedOracle(Oracle):
    """The oracle `reached`: the whole body flies through the opening of each gate, in order.

    A gate is passed once the body is beyond its plane by its radius, and every point of it crossed
    the plane inside the opening. A passage beside a gate, from the wrong side or out of order, and
    a dip in and out again do not count. actual: the offset of the centre with the smallest margin;
    limit: half of that gate's inner size, less what the body reaches beyond its centre.
    """

    def __init__(
        self,
        terms: OracleTerms,
        *,
        route: Sequence[tuple[str, GateOpening]],
        events: Mapping[str, float],
        direction: Direction = "away",
        body_half_m: Vec3 = _POINT,
    ) -> None:
        super().__init__(terms)
        if not route:
            raise OracleError(f"oracle {self.name!r}: the goal names no gate")
        self._route = tuple(route)
        self._events = events
        self._direction = direction
        self._body = PassingBody(body_half_m)
        self._last: PoseSample | None = None
        self._detectors: dict[str, PassageDetector] = {}
        self._home: int | None = None
        self._through: list[_Through] = []
        self._wrong: dict[str, str] = {}

    def on_pose(self, sample: PoseSample) -> Flags:
        """Judge whether the path since the last pose leads through the next gate."""
        last, self._last = self._last or sample, sample
        if self._done or not self.stages.covers(sample.t_s):
            return NO_FLAGS
        if not self._detectors:
            self._detectors = {
                name: PassageDetector(gate, self._body, last, self._events)
                for name, gate in self._route
            }
        if self._home is None:
            self._home = self._detectors[self._route[len(self._through)][0]].side
        flags: Flags = NO_FLAGS
        for name, detector in self._detectors.items():
            found = detector.observe(sample)
            if isinstance(found, GatePassage):
                flags += self._pass(name, found)
            elif isinstance(found, GateDip) and name == self._next:
                self._note(name, f"entered {name} by {found.depth_m:.2f} m and came back")
        return flags

    def result(self, t_s: float) -> OracleResult:
        """Return the largest offset, or which gate was not reached."""
        del t_s
        if not self._done:
            limit_m = self._route[len(self._through)][1].limit_m
            return self.verdict(passed=False, limit=limit_m, unit="m", detail=self._missing_text())
        worst = min(self._through, key=lambda passage: passage.limit_m - passage.offset_m)
        return self.verdict(
            passed=True,
            actual=worst.offset_m,
            limit=worst.limit_m,
            unit="m",
            margin=worst.limit_m - worst.offset_m,
            at_s=worst.at_s,
            detail=f"through {worst.gate}",
        )

    @property
    def _done(self) -> bool:
        return len(self._through) == len(self._route)

    @property
    def _next(self) -> str:
        return "" if self._done else self._route[len(self._through)][0]

    def _right_way(self, direction: int) -> bool:
        match self._direction:
            case "either":
                return True
            case "along":
                return direction == 1
            case "against":
                return direction == -1
            case "away":
                return direction != self._home

    def _pass(self, name: str, passage: GatePassage) -> Flags:
        """Handle a passage of the body through the plane of a gate of the route."""
        gate = dict(self._route)[name]
        inside = passage.reach_m < gate.limit_m
        if name != self._next:
            if inside and all(name != through.gate for through in self._through):
                self._note(name, f"flew through {name} before {self._next}")
            return NO_FLAGS
        if not self._right_way(passage.direction):
            if inside:
                self._note(name, f"flew through {name} the wrong way")
            return NO_FLAGS
        if not inside:
            return self._beside(name, gate, passage)
        limit_m = gate.limit_m - (passage.reach_m - passage.offset_m)
        self._through.append(_Through(name, passage.offset_m, limit_m, passage.at_s))
        self._home = None
        self._wrong = {text: gate for text, gate in self._wrong.items() if gate != name}
        return self.flag(passage.at_s, f"{self.vehicle} flew through {name}", decisive=False)

    def _beside(self, name: str, gate: GateOpening, passage: GatePassage) -> Flags:
        if passage.offset_m < gate.limit_m:
            over_m = passage.reach_m - gate.limit_m
            self._note(name, f"passed {name} with its body {over_m:.2f} m beyond the opening")
        else:
            self._note(name, f"passed {passage.offset_m:.2f} m beside the centre of {name}")
        return self.flag(passage.at_s, f"{self.vehicle} passed beside {name}", decisive=False)

    def _note(self, gate: str, text: str) -> None:
        """Note an unsuccessful passage once; it is removed when its gate is reached after all."""
        self._wrong.setdefault(text, gate)

    def _missing_text(self) -> str:
        if self._last is None:
            return "no pose seen"
        done, total = len(self._through), len(self._route)
        text = f"never flew through {self._next} ({done} of {total} gates)"
        return "; ".join([text, *list(self._wrong)[:_MOST_NOTES], *self._unfinished_texts()])

    def _unfinished_texts(self) -> Iterator[str]:
        detector = self._detectors.get(self._next)
        if detector is not None and (depth_m := detector.unfinished_m) > 0.0:
            far_m = self._body.radius_m
            ended = f"ended {depth_m:.2f} m past its plane"
            yield f"{ended}: through is {far_m:.2f} m, the radius of its body"


_MOST_NOTES = 3
"""How many unsuccessful passages a reason names."""


@oracle(
    "reached",
    "flies with its whole body through the goal's gates, in order and direction",
    ReachedParameters,
    window=ON_GOAL,
    at_the_end=True,
    objects=lambda given, _: given.gates or (),
)
def reached(terms: OracleTerms, parameters: ReachedParameters, context: OracleContext) -> Oracle:
    """Return the oracle of reached gates. Raises OracleError when one is not in the world."""
    route = context.route if parameters.gates is None else parameters.gates
    for gate in route:
        if gate not in context.gates:
            known = ", ".join(context.gates) or "none"
            message = f"the judged world has no gate {gate!r} (it has {known})"
            raise OracleError(f"oracle {terms.name!r}: {message}")
    return ReachedOracle(
        terms,
        route=[(gate, context.gates[gate]) for gate in route],
        events=context.events,
        direction=parameters.direction,
        body_half_m=context.body_half_m,
    )
