"""The judge of a run: feeds each oracle its samples, collects flags and results."""

import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from wil_campaign.installed_plugins import plugin_of_module, whose_fault_text
from wil_campaign.safety.evaluation.oracle_answers import checked_flags, checked_result
from wil_campaign.safety.evidence.evidence import Evidence
from wil_campaign.safety.model.oracle_results import EvidenceResult, Flag, OracleResult
from wil_campaign.safety.model.samples import (
    DoubtSample,
    DropOutSample,
    FenceSample,
    GroundSpeedSample,
    HeadingSample,
    LinkSample,
    PoseSample,
    ReferenceSample,
    ReportSample,
    StageSample,
    StateSample,
)
from wil_campaign.safety.model.verdict import GOAL_TIMEOUT, DecisiveEvent, event_source_of
from wil_campaign.safety.oracles.contact import ContactParameters
from wil_campaign.safety.oracles.goal import TimeLimitOracle
from wil_campaign.safety.oracles.oracle import (
    Oracle,
    OracleContext,
    OracleError,
    OracleParameters,
    OracleTerms,
)
from wil_campaign.safety.oracles.oracle_terms import FLIGHT
from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.safety.oracles.touchdown import TouchdownParameters
from wil_campaign.safety.oracles.vehicle_health import LandedOracle

S = TypeVar("S")
Handler = Callable[[S], tuple[Flag, ...]]


@dataclass(frozen=True, slots=True)
class OracleUse:
    """An oracle that the judge is to run: its name in results, its kind among `oracle_kinds`."""

    name: str
    kind: str
    parameters: OracleParameters


COLLISION_ALWAYS = OracleUse("collision_always", "collision", ContactParameters())
"""A contact fails a run, whatever parameters its campaign gives to the oracle `collision`."""
TOUCHDOWN_ALWAYS = OracleUse("touchdown_always", "touchdown", TouchdownParameters())
"""A touchdown faster than the vehicle's profile allows fails a run that states no other limit."""
_LANDED_ALWAYS = "landed_always"
ALWAYS_JUDGED = (COLLISION_ALWAYS.name, TOUCHDOWN_ALWAYS.name, _LANDED_ALWAYS)
"""Oracles that a campaign has without naming them."""


def build_oracles(
    uses: Sequence[OracleUse],
    contexts: Mapping[str, OracleContext],
    *,
    collision_always: bool = True,
) -> tuple[Oracle, ...]:
    """Return the oracles of one run's judge; `contexts`: one per vehicle that flies in it.

    An oracle that names no vehicle judges the subject, and in mode wil also the twin, not required.
    One that names a vehicle which does not fly in this mode is left out. Three are added: that a
    real vehicle is on the ground and disarmed at the end; that the subject meets the ground no
    faster than its profile says, unless a required `touchdown` judges that; and, with
    collision_always, that it touches nothing, unless the campaign itself uses a `collision` that
    judges as much. Objects that any use names as `ground` are ground there too. Raises OracleError.
    """
    oracles = [oracle for use in uses for oracle in _of_use(use, contexts)]
    if "real" in contexts and not any(_is_final(oracle) for oracle in oracles):
        oracles.append(
            LandedOracle(OracleTerms(name=_LANDED_ALWAYS, vehicle="real", required=True))
        )
    for vehicle, context in contexts.items():
        judged = any(_judges_every_contact(use, vehicle) for use in uses)
        subject = vehicle == context.subject and context.probe is not None
        if collision_always and subject and not judged:
            always = replace(
                COLLISION_ALWAYS, parameters=ContactParameters(ground=ground_objects(uses))
            )
            oracles += _of_use(always, {vehicle: context})
        has_limit = vehicle == context.subject and context.touchdown_m_s is not None
        if has_limit and not any(_judges_landing(use, vehicle) for use in uses):
            oracles += _of_use(TOUCHDOWN_ALWAYS, {vehicle: context})
    _require_unique(oracles)
    return tuple(oracles)


def _of_use(use: OracleUse, contexts: Mapping[str, OracleContext]) -> Iterable[Oracle]:
    """Return the oracles of one use for the judge, one per vehicle or pair. Raises OracleError."""
    spec = oracle_kinds().get(use.kind)
    if spec is None:
        known = ", ".join(sorted(oracle_kinds()))
        raise OracleError(f"there is no oracle {use.kind!r}; there are {known}")
    needs_pair = spec.needs_pair(use.parameters)
    if needs_pair and len(contexts) < 2:
        return
    named, required = use.parameters.vehicle, use.parameters.required
    for vehicle, context in contexts.items():
        if vehicle == (named or context.subject):
            yield spec.build(use.name, use.parameters, context, required=required)
        elif named is None and not needs_pair:
            yield spec.build(use.name, use.parameters, context, required=False)


def _is_final(oracle: Oracle) -> bool:
    """Return whether an oracle judges the end of the flight: the real vehicle has landed."""
    return isinstance(oracle, LandedOracle) and oracle.vehicle == "real" and oracle.required


def _judges_every_contact(use: OracleUse, subject: str) -> bool:
    """Return whether a use of an oracle includes what `collision_always` judges."""
    given = use.parameters
    if use.kind != "collision" or not isinstance(given, ContactParameters):
        return False
    whole = given.from_ in {None, FLIGHT.first} and given.to in {None, FLIGHT.last, "end"}
    return given.required and given.vehicle in {None, subject} and whole and not given.exclude


def _judges_landing(use: OracleUse, subject: str) -> bool:
    """Return whether a use of an oracle judges how fast the subject meets the ground."""
    given = use.parameters
    return use.kind == "touchdown" and given.required and given.vehicle in {None, subject}


def unjudged_contacts(uses: Iterable[OracleUse], *, collision_always: bool) -> tuple[str, ...]:
    """Return the contacts that a campaign excludes from being judged always, as texts."""
    if not collision_always:
        return (COLLISION_ALWAYS.name,)
    return tuple(f"contact with {name} at takeoff and landing" for name in ground_objects(uses))


def ground_objects(uses: Iterable[OracleUse]) -> tuple[str, ...]:
    """Return the objects that any oracle use names as ground for takeoff and landing."""
    given = (use.parameters for use in uses)
    names = (
        name
        for parameters in given
        if isinstance(parameters, ContactParameters)
        for name in parameters.ground
    )
    return tuple(dict.fromkeys(names))


def _require_unique(oracles: Iterable[Oracle]) -> None:
    """Raise OracleError when two oracles of the judge have one name and vehicle."""
    seen: set[str] = set()
    for oracle in oracles:
        source = event_source_of(oracle.name, oracle.vehicle)
        if source in seen:
            raise OracleError(f"two oracles are named {oracle.name!r} for {oracle.vehicle!r}")
        seen.add(source)


class Judge:
    """The judge of a run: feeds samples, in time order, to all oracles that watch their vehicle.

    All samples are evidence too: a required signal that does not show what happened is decisive,
    and INVALID. A pose that is not finite reaches no oracle. Samples of a vehicle without oracles
    are ignored.
    """

    def __init__(self, oracles: Iterable[Oracle], evidence: Evidence | None = None) -> None:
        self.oracles = tuple(oracles)
        self._evidence = evidence or Evidence()
        self._taken = 0
        self._required = {event_source_of(o.name, o.vehicle) for o in self.oracles if o.required}
        self._fail_fast = {
            event_source_of(o.name, o.vehicle) for o in self.oracles if o.terms.fail_fast
        }
        self._flags: list[Flag] = []
        self._ended: dict[str, OracleResult] = {}
        self._connect(self.oracles)
        self._events: list[DecisiveEvent] = []

    @property
    def flags(self) -> tuple[Flag, ...]:
        """Return all flags of the judge's oracles so far, in the order of raising."""
        return tuple(self._flags)

    @property
    def decisive(self) -> tuple[DecisiveEvent, ...]:
        """Return the judge's first decisive flags: of required oracles, and missing evidence."""
        return tuple(self._events)

    @property
    def evidence(self) -> tuple[EvidenceResult, ...]:
        """Return the evidence results: what the judge's signals have shown so far."""
        return self._evidence.results()

    @property
    def timeouts(self) -> frozenset[str]:
        """Return the sources of the judge's events that only report that the time is up."""
        limits = (oracle for oracle in self.oracles if isinstance(oracle, TimeLimitOracle))
        return frozenset(
            {
                GOAL_TIMEOUT,
                *(event_source_of(time_limit.name, time_limit.vehicle) for time_limit in limits),
            }
        )

    @property
    def worst_texts(self) -> Mapping[str, str]:
        """Return the worst values of the judge's oracles, by the sources of their events."""
        return {
            event_source_of(oracle.name, oracle.vehicle): oracle.worst_text
            for oracle in self.oracles
        }

    @property
    def landings(self) -> frozenset[str]:
        """Return the sources of the judge's events that a vehicle was not landed at the end."""
        ends = (oracle for oracle in self.oracles if isinstance(oracle, LandedOracle))
        return frozenset(event_source_of(end.name, end.vehicle) for end in ends)

    def pose(self, sample: PoseSample) -> tuple[Flag, ...]:
        """Feed a pose to the judge; return new flags."""
        is_finite = self._evidence.pose(sample)
        self._receive_evidence()
        if not is_finite:
            return ()
        return self._feed_oracles(self._poses.get(sample.vehicle, ()), sample)

    def state(self, sample: StateSample) -> tuple[Flag, ...]:
        """Feed a vehicle's state to the judge; return new flags."""
        self._evidence.state(sample)
        flags = self._feed_oracles(self._states.get(sample.vehicle, ()), sample)
        self._receive_evidence()
        return flags

    def received(self, sample: LinkSample) -> tuple[Flag, ...]:
        """Feed to the judge that a vehicle's link delivered something; return new flags."""
        self._evidence.received(sample)
        return self._feed_oracles(self._links.get(sample.vehicle, ()), sample)

    def reference(self, sample: ReferenceSample) -> tuple[Flag, ...]:
        """Feed another source's position of a vehicle to the judge; return new flags."""
        is_finite = self._evidence.reference(sample)
        self._receive_evidence()
        if not is_finite:
            return ()
        return self._feed_oracles(self._references.get(sample.vehicle, ()), sample)

    def needs_ground_speed(self, vehicle: str) -> bool:
        """Return whether the judge compares speeds of other sources of a vehicle."""
        return self._evidence.needs_ground_speed(vehicle)

    def ground_speed(self, sample: GroundSpeedSample) -> None:
        """Feed another source's horizontal speed of a vehicle to the judge."""
        self._evidence.ground_speed(sample)
        self._receive_evidence()

    def needs_heading(self, vehicle: str) -> bool:
        """Return whether the judge compares the heading of a vehicle's estimate."""
        return self._evidence.needs_heading(vehicle)

    def heading(self, sample: HeadingSample) -> None:
        """Feed a comparison of a vehicle's estimated heading to the judge."""
        self._evidence.heading(sample)
        self._receive_evidence()

    def report(self, sample: ReportSample) -> None:
        """Feed to the judge that a sample of a signal has arrived."""
        self._evidence.report(sample)
        self._receive_evidence()

    def doubt(self, sample: DoubtSample) -> None:
        """Feed to the judge that a signal is not credible: decisive, and INVALID."""
        self._evidence.doubt(sample)
        self._receive_evidence()

    def fence(self, sample: FenceSample) -> tuple[Flag, ...]:
        """Feed a vehicle's changed fence to the judge; return new flags."""
        return self._feed_oracles(self._fences.get(sample.vehicle, ()), sample)

    def stage(self, sample: StageSample) -> tuple[Flag, ...]:
        """Feed a stage, of one vehicle or of all, to the judge; return new flags."""
        handlers = [
            o.on_stage
            for o in self._stages
            if sample.vehicle is None or sample.vehicle == o.vehicle
        ]
        flags = self._feed_oracles(handlers, sample)
        self._evidence.stage(sample)
        self._receive_evidence()
        return flags

    def tick(self, t_s: float) -> tuple[Flag, ...]:
        """Feed the passing of time to the judge (10 Hz is plenty); return new flags."""
        flags = self._feed_oracles(self._ticks, t_s)
        self._evidence.tick(t_s)
        self._receive_evidence()
        return flags

    def drop_out(self, sample: DropOutSample) -> None:
        """Handle a vehicle that left the flight: what is not required of it ends.

        What it does from then on, such as the guard's landing, is no part of the test, nor is how
        far others are from it. Required oracles are judged to the end.
        """
        for oracle in self.oracles:
            source = event_source_of(oracle.name, oracle.vehicle)
            if sample.vehicle in oracle.watches and not oracle.required:
                self._ended.setdefault(source, self._result_at_drop_out(oracle, sample))
        self._connect(
            [
                one
                for one in self.oracles
                if event_source_of(one.name, one.vehicle) not in self._ended
            ]
        )
        self._evidence.drop_out(sample)
        self._receive_evidence()

    def ends_flight(self, event: DecisiveEvent) -> bool:
        """Return whether the judge ends the flight now for a decisive event."""
        return event.kind != "FAIL" or event.source in self._fail_fast

    def results(self, t_s: float) -> tuple[OracleResult, ...]:
        """Return the judge's result of every oracle as of `t_s`, in the campaign's order.

        That of one whose vehicle dropped out is as of then.
        """
        return tuple(
            self._ended.get(event_source_of(oracle.name, oracle.vehicle)) or _result_of(oracle, t_s)
            for oracle in self.oracles
        )

    def so_far(self, t_s: float) -> tuple[tuple[OracleResult, bool], ...]:
        """Return each oracle's result so far, and whether it has failed, whatever follows.

        Another FAIL means "not yet", as of a goal that is not reached.
        """
        settled = {
            event_source_of(flag.oracle, flag.vehicle) for flag in self._flags if flag.decisive
        }
        found: list[tuple[OracleResult, bool]] = []
        for oracle in self.oracles:
            source = event_source_of(oracle.name, oracle.vehicle)
            result = self._ended.get(source) or checked_result(oracle, oracle.so_far(t_s))
            is_certain = oracle.is_certain or source in settled or source in self._ended
            found.append((result, is_certain and result.verdict == "FAIL"))
        return tuple(found)

    def _result_at_drop_out(self, oracle: Oracle, sample: DropOutSample) -> OracleResult:
        """Return the result of an oracle of which a vehicle leaves the flight now.

        A failure without a decisive flag is INVALID: the vehicle had not done something yet, and
        whether it would have is unknown.
        """
        t_s, left = sample.t_s, sample.vehicle
        result = _result_of(oracle, t_s)
        name, vehicle, since = oracle.name, oracle.vehicle, oracle.stages.since(t_s)
        is_settled = any(
            flag.decisive and (flag.oracle, flag.vehicle) == (name, vehicle) for flag in self._flags
        )
        if result.verdict == "FAIL" and not is_settled:
            reason = f"{left} dropped out{since}, before this was decided"
            return oracle.invalid(reason, at_s=t_s)
        until = f"judged until {left} dropped out{since}"
        return replace(result, detail=f"{result.detail}; {until}" if result.detail else until)

    def _connect(self, oracles: Sequence[Oracle]) -> None:
        """Feed only these oracles from now on."""
        self._poses = _table(oracles, "on_pose")
        self._references = _table(oracles, "on_reference")
        self._states = _table(oracles, "on_state")
        self._links = _table(oracles, "on_received")
        self._fences = _table(oracles, "on_fence")
        self._stages = tuple(oracles)
        self._ticks = [oracle.on_tick for oracle in oracles if _overrides(oracle, "on_tick")]

    def _feed_oracles(self, handlers: Iterable[Handler[S]], sample: S) -> tuple[Flag, ...]:
        new: list[Flag] = []
        raised: Exception | None = None
        for handler in handlers:
            try:
                if flags := handler(sample):
                    new += checked_flags(flags)
            except Exception as error:  # noqa: BLE001 - the others judge on, and it is raised below
                raised = raised or error
                self._leave_out(handler, error)
        self._flags += new
        for flag in new:
            source = event_source_of(flag.oracle, flag.vehicle)
            if flag.decisive and source in self._required:
                self._event_once(DecisiveEvent(flag.t_s, "FAIL", flag.text, source))
        if raised is not None:
            raise raised
        return tuple(new)

    def _leave_out(self, handler: Handler[S], error: Exception) -> None:
        """Feed an oracle nothing more after its exception, and name it there."""
        oracle = next(one for one in self.oracles if one is getattr(handler, "__self__", None))
        _note_oracle(error, oracle)
        self._ended[event_source_of(oracle.name, oracle.vehicle)] = oracle.invalid(
            "it raised an error"
        )
        self._connect(
            [
                one
                for one in self.oracles
                if event_source_of(one.name, one.vehicle) not in self._ended
            ]
        )

    def _receive_evidence(self) -> None:
        events = self._evidence.events
        while self._taken < len(events):
            self._event_once(events[self._taken])
            self._taken += 1

    def _event_once(self, event: DecisiveEvent) -> None:
        if all(known.source != event.source for known in self._events):
            self._events.append(event)


def _result_of(oracle: Oracle, t_s: float) -> OracleResult:
    """Return an oracle's result; an exception of it names the oracle."""
    try:
        return checked_result(oracle, oracle.result(t_s))
    except Exception as error:
        _note_oracle(error, oracle)
        raise


def _note_oracle(error: Exception, oracle: Oracle) -> None:
    """Add to an exception which oracle raised it, and where, or returned what is no answer."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    is_answer = last.filename == checked_result.__code__.co_filename
    place = "" if is_answer else f", {Path(last.filename).name} line {last.lineno}"
    whose = whose_fault_text(plugin_of_module(type(oracle).__module__))
    error.add_note(f"(oracle {oracle.name!r} of {oracle.vehicle}{place}){whose}")


def _overrides(oracle: Oracle, method: str) -> bool:
    """Return whether an oracle overrides a method, so that the judge has to call it."""
    return getattr(type(oracle), method) is not getattr(Oracle, method)


def _table(oracles: Iterable[Oracle], method: str) -> dict[str, list[Handler[object]]]:
    """Return by vehicle the methods that the judge calls with its samples."""
    table: dict[str, list[Handler[object]]] = {}
    for oracle in oracles:
        if _overrides(oracle, method):
            for vehicle in oracle.watches:
                table.setdefault(vehicle, []).append(getattr(oracle, method))
    return table
