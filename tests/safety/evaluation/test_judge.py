import math
from dataclasses import replace
from typing import Any, Self

import pytest

from wil_campaign.safety.evaluation.judge import Judge, OracleUse, build_oracles, unjudged_contacts
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import (
    DropOutSample,
    LinkSample,
    PoseSample,
    ReferenceSample,
    StageSample,
    StateSample,
)
from wil_campaign.safety.model.verdict import DecisiveEvent, DecisiveKind
from wil_campaign.safety.oracles.oracle import (
    Flags,
    Oracle,
    OracleContext,
    OracleError,
    OracleTerms,
    RunMode,
    Windowed,
)
from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.worlds.frames import Pose, Vec3

FENCE = Fence.box(north_m=(-1, 4), east_m=(-2, 2), up_m=(-0.5, 2.5))


def use(kind: str, *, name: str = "", **parameters: object) -> OracleUse:
    return OracleUse(name or kind, kind, oracle_kinds()[kind].parameters.model_validate(parameters))


def contexts(mode: RunMode) -> dict[str, OracleContext]:
    flying = {"sim": ["twin"], "wil": ["real", "twin"], "real": ["real"]}[mode]
    return {
        vehicle: OracleContext(mode=mode, subject=flying[0], vehicle=vehicle, fence=FENCE)
        for vehicle in flying
    }


def judged(mode: RunMode, *uses: OracleUse) -> list[tuple[str, str, bool]]:
    return [(o.name, o.vehicle, o.required) for o in build_oracles(uses, contexts(mode))]


def test_a_profile_with_a_touchdown_limit_judges_the_landing_of_its_subject_alone() -> None:
    limited = {name: replace(one, touchdown_m_s=1.5) for name, one in contexts("wil").items()}
    added = [(o.name, o.vehicle) for o in build_oracles((), limited)]
    assert added == [("landed_always", "real"), ("touchdown_always", "real")]
    assert [name for name, *_ in judged("wil")] == ["landed_always"]
    required = use("touchdown", max_m_s=1.0, required=True)
    own = [(o.name, o.vehicle) for o in build_oracles((required,), limited)]
    assert ("touchdown_always", "real") not in own


def pose(t_s: float, vehicle: str, at: Vec3) -> PoseSample:
    return PoseSample(t_s, vehicle, Pose(at), (0, 0, 0))


def state(t_s: float, vehicle: str, *, armed: bool, landed: bool) -> StateSample:
    return StateSample(t_s, vehicle, armed, FlightMode.LAND, "LAND", landed)


class Broken(Oracle):
    """Raises at each pose, as the oracle of a plugin may."""

    def on_pose(self, sample: PoseSample) -> Flags:
        raise IndexError(f"nothing at {sample.t_s}")

    def result(self, t_s: float) -> OracleResult:
        del t_s
        return self.verdict(passed=True)


def test_an_oracle_that_raises_is_named_once_and_the_others_judge_on() -> None:
    (fence,) = build_oracles([use("geofence")], contexts("sim"))
    judge = Judge([Broken(OracleTerms(name="gentle", vehicle="twin", required=True)), fence])
    judge.stage(StageSample(0.0, "takeoff"))
    with pytest.raises(IndexError) as raised:
        judge.pose(pose(1.0, "twin", (0, 0, -9)))
    (note,) = raised.value.__notes__
    assert note.startswith("(oracle 'gentle' of twin, test_judge.py line ")
    assert [event.source for event in judge.decisive] == ["geofence/twin"]
    assert judge.pose(pose(1.1, "twin", (0, 0, -9))) == ()
    found = {result.name: result.verdict for result in judge.results(2.0)}
    assert found == {"gentle": "INVALID", "geofence": "FAIL"}


def test_an_oracle_whose_result_raises_is_named() -> None:
    class Unsure(Oracle):
        def result(self, t_s: float) -> OracleResult:
            raise IndexError(f"nothing at {t_s}")

    judge = Judge([Unsure(OracleTerms(name="gentle", vehicle="twin", required=True))])
    with pytest.raises(IndexError) as raised:
        judge.results(2.0)
    assert raised.value.__notes__[0].startswith("(oracle 'gentle' of twin, test_judge.py line ")


def test_an_oracle_that_cannot_be_made_is_named() -> None:
    def raises(*_: object) -> Oracle:
        raise NameError("name 'Gntle' is not defined")

    spec = replace(oracle_kinds()["geofence"], factory=raises)
    with pytest.raises(NameError) as raised:
        spec.build("gentle", Windowed(), contexts("sim")["twin"], required=True)
    assert raised.value.__notes__ == [f"(oracle 'gentle', made by {__name__})"]


def test_a_failure_in_flight_is_no_goal_that_is_not_reached_yet() -> None:
    goal = OracleContext(
        mode="real", subject="real", vehicle="real", fence=FENCE, target_ned_m=(3, 0, -1)
    )
    uses = (
        use("geofence"),
        use("reached_position", tolerance_m=0.3),
        use("stl", stl="always (up_m >= 0.5)"),
    )
    judge = Judge(build_oracles(uses, {"real": goal}))

    def failed() -> dict[str, tuple[str, bool]]:
        return {
            result.name: (result.verdict, has_failed)
            for result, has_failed in judge.so_far(3.5)
            if result.verdict == "FAIL"
        }

    judge.stage(StageSample(1.0, "takeoff"))
    judge.stage(StageSample(2.0, "at_height"))
    judge.stage(StageSample(3.0, "goal"))
    judge.pose(pose(3.1, "real", (0, 0, -1)))
    assert failed() == {"reached_position": ("FAIL", False)}
    judge.pose(pose(3.2, "real", (0, 5, -0.25)))
    assert failed()["geofence"] == ("FAIL", True)
    judge.stage(StageSample(3.3, "land"))
    assert failed()["stl"] == ("FAIL", True)


class Referred(Oracle):
    """Keeps the poses by other sources that it is given."""

    def __init__(self, terms: OracleTerms) -> None:
        super().__init__(terms)
        self.seen: list[str] = []

    def on_reference(self, sample: ReferenceSample) -> Flags:
        self.seen.append(sample.source)
        return self.flag(sample.t_s, "too far")

    def result(self, t_s: float) -> OracleResult:
        return self.verdict(passed=not self.seen)


def test_an_oracle_gets_the_poses_of_its_vehicle_by_other_sources() -> None:
    (built, *_) = build_oracles([use("altitude", vehicle="twin", max_m=3)], contexts("wil"))
    assert built.vehicle == "twin"
    oracle = Referred(built.terms)
    judge = Judge([oracle])
    for vehicle, north_m in (("twin", 1.0), ("real", 1.0), ("twin", math.nan)):
        place = (north_m, 0.0, -1.0)
        judge.reference(ReferenceSample(1.0, vehicle, "mavlink", place, (0.0, 0.0, 0.0)))
    assert oracle.seen == ["mavlink"]
    assert [flag.text for flag in judge.flags] == ["too far"]
    assert [event.text for event in judge.decisive] == ["too far"]


def test_each_mode_judges_its_own_vehicle() -> None:
    uses = (
        use("geofence"),
        use("landed"),
        use("twin_divergence"),
        use("altitude", vehicle="twin", max_m=3),
        use("link", required=False, max_gap_s=1),
    )
    assert judged("wil", *uses) == [
        ("geofence", "real", True),
        ("geofence", "twin", False),
        ("landed", "real", True),
        ("landed", "twin", False),
        ("twin_divergence", "real", False),
        ("altitude", "twin", True),
        ("link", "real", False),
        ("link", "twin", False),
    ]
    assert judged("sim", *uses) == [
        ("geofence", "twin", True),
        ("landed", "twin", True),
        ("altitude", "twin", True),
        ("link", "twin", False),
    ]
    assert judged("real", *uses) == [
        ("geofence", "real", True),
        ("landed", "real", True),
        ("link", "real", False),
    ]


@pytest.mark.parametrize(
    "uses", [(), (use("landed", required=False),), (use("landed", vehicle="twin"),)]
)
def test_a_real_vehicle_still_armed_at_the_end_always_fails(uses: tuple[OracleUse, ...]) -> None:
    oracles = build_oracles(uses, contexts("wil"))
    judge = Judge(oracles)
    judge.state(state(1.0, "real", armed=True, landed=True))
    assert any(
        r.required and r.verdict == "FAIL" for r in judge.results(2.0) if r.vehicle == "real"
    )
    assert judged("sim") == []


def test_one_kind_may_be_used_under_two_names_and_a_name_once() -> None:
    both = judged("sim", use("altitude", max_m=3), use("altitude", name="low", max_m=1))
    assert [name for name, _, _ in both] == ["altitude", "low"]
    with pytest.raises(OracleError, match="two oracles are named 'altitude'"):
        judged("sim", use("altitude", max_m=3), use("altitude", max_m=1))


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(OracleError, match="no oracle 'crash'"):
        judged("sim", OracleUse("crash", "crash", oracle_kinds()["landed"].parameters()))


def test_each_vehicle_is_judged_by_its_own_samples() -> None:
    judge = Judge(build_oracles([use("geofence"), use("landed")], contexts("wil")))
    judge.stage(StageSample(0.0, "takeoff"))
    assert judge.pose(pose(1.0, "real", (0, 0, -1))) == ()
    flags = judge.pose(pose(1.0, "twin", (9, 0, -1)))
    assert [(f.vehicle, f.oracle) for f in flags] == [("twin", "geofence")]
    assert judge.flags == flags
    # The twin's exit is reported, and settles nothing.
    assert judge.decisive == ()
    verdicts = {(r.name, r.vehicle): r.verdict for r in judge.results(2.0)}
    assert verdicts["geofence", "real"] == "PASS"
    assert verdicts["geofence", "twin"] == "FAIL"


def test_a_vehicle_that_dropped_out_is_judged_until_then_and_the_others_to_the_end() -> None:
    uses = [use("geofence"), use("altitude", max_m=3), use("time_limit", limit_s=10)]
    uses.append(use("altitude", name="kept", vehicle="twin", max_m=3))
    judge = Judge(build_oracles(uses, contexts("wil")))
    judge.stage(StageSample(0.0, "takeoff"))
    judge.stage(StageSample(0.0, "goal"))
    judge.pose(pose(1.0, "twin", (0, 0, -2)))
    judge.pose(pose(1.0, "real", (0, 0, -2)))
    judge.pose(pose(1.5, "twin", (9, 0, -2)))
    judge.drop_out(DropOutSample(2.0, "twin"))
    for vehicle in ("twin", "real"):
        judge.pose(pose(3.0, vehicle, (0, 0, -9)))
    judge.tick(20.0)
    flags = [(flag.oracle, flag.vehicle) for flag in judge.flags if flag.t_s > 2.0]
    reported = [flag for flag in flags if flag[1] == "twin" and flag[0] != "kept"]
    assert reported == []
    # What is required of the twin is judged to the end, as is the other vehicle.
    assert {("kept", "twin"), ("altitude", "real"), ("time_limit", "real")} <= set(flags)
    results = {(one.name, one.vehicle): one for one in judge.results(20.0)}
    fence = results["geofence", "twin"]
    assert (fence.verdict, fence.at_s) == ("FAIL", 1.5)
    height = results["altitude", "twin"]
    assert (height.verdict, height.actual) == ("PASS", 2.0)
    assert height.detail == "judged until twin dropped out 2.00 s after the goal"
    time_limit = results["time_limit", "twin"]
    assert time_limit.verdict == "INVALID"
    assert time_limit.detail == "twin dropped out 2.00 s after the goal, before this was decided"
    assert results["altitude", "real"].verdict == "FAIL"
    assert results["kept", "twin"].verdict == "FAIL"


def test_how_far_a_vehicle_is_from_one_that_dropped_out_is_judged_until_then() -> None:
    """Its last pose went on by its last velocity: the report told of distances that nobody flew."""
    uses = [use("twin_divergence", max_m=2), use("twin_divergence", name="kept", required=True)]
    judge = Judge(build_oracles(uses, contexts("wil")))
    judge.stage(StageSample(0.0, "takeoff"))
    for vehicle in ("real", "twin"):
        judge.pose(pose(1.0, vehicle, (0, 0, -2)))
    judge.drop_out(DropOutSample(2.0, "twin"))
    assert judge.pose(pose(9.0, "real", (7, 0, -2))) == ()
    apart, kept = (one for one in judge.results(9.0) if one.unit == "m" and one.actual is not None)
    assert (apart.name, apart.verdict, apart.actual) == ("twin_divergence", "PASS", 0.0)
    assert apart.detail == "judged until twin dropped out 2.00 s after the takeoff command"
    assert (kept.name, kept.actual) == ("kept", 7.0)


@pytest.mark.parametrize(
    ("kind", "source", "ends"),
    [
        ("FAIL", "geofence/real", False),
        ("FAIL", "altitude/real", True),
        ("INVALID", "geofence/real", True),
        ("ERROR", "", True),
    ],
)
def test_a_failure_ends_the_flight_where_its_oracle_is_to_fail_fast_all_else_at_once(
    kind: DecisiveKind, source: str, ends: bool
) -> None:
    uses = [use("geofence"), use("altitude", max_m=3, fail_fast=True)]
    judge = Judge(build_oracles(uses, contexts("real")))
    assert judge.ends_flight(DecisiveEvent(1.0, kind, "for the test", source)) is ends


def test_a_decisive_flag_of_a_required_oracle_settles_the_run_once() -> None:
    judge = Judge(build_oracles([use("geofence")], contexts("real")))
    judge.stage(StageSample(0.0, "takeoff"))
    for t_s, north_m in ((1.0, 9.0), (2.0, 0.0), (3.0, 9.0)):
        judge.pose(pose(t_s, "real", (north_m, 0, -1)))
    assert len(judge.flags) == 2
    assert [(e.t_s, e.kind, e.source) for e in judge.decisive] == [(1.0, "FAIL", "geofence/real")]


def test_a_stage_of_one_vehicle_is_not_the_other_s() -> None:
    judge = Judge(build_oracles([use("time_limit", limit_s=10)], contexts("wil")))
    judge.stage(StageSample(0.0, "goal"))
    judge.stage(StageSample(4.0, "done", "twin"))
    judge.tick(10.5)
    results = [r for r in judge.results(11.0) if r.name == "time_limit"]
    verdicts = {r.vehicle: (r.verdict, r.actual) for r in results}
    assert verdicts == {
        "real": ("FAIL", 11.0),
        "twin": ("PASS", 4.0),
    }
    assert [f.vehicle for f in judge.flags] == ["real"]


def test_time_alone_is_judged_too() -> None:
    judge = Judge(build_oracles([use("time_limit", limit_s=1)], contexts("sim")))
    judge.stage(StageSample(0.5, "goal"))
    assert judge.tick(1.0) == ()
    assert [f.oracle for f in judge.tick(2.0)] == ["time_limit"]


def test_silence_is_judged_by_what_is_received() -> None:
    judge = Judge(build_oracles([use("link", max_gap_s=1)], contexts("sim")))
    judge.stage(StageSample(0.0, "takeoff"))
    judge.received(LinkSample(0.5, "twin"))
    assert [f.oracle for f in judge.received(LinkSample(2.0, "twin"))] == ["link"]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("where", ["position", "attitude", "velocity"])
def test_a_pose_that_is_not_finite_is_invalid_and_not_judged(bad: float, where: str) -> None:
    judge = Judge(build_oracles([use("geofence")], contexts("real")))
    judge.stage(StageSample(0.0, "takeoff"))
    sample = PoseSample(
        1.0,
        "real",
        Pose(
            (bad if where == "position" else 0.0, 0, -1),
            (1, 0, 0, bad if where == "attitude" else 0.0),
        ),
        (bad if where == "velocity" else 0.0, 0, 0),
    )
    assert judge.pose(sample) == ()
    assert judge.pose(sample) == ()
    assert [(e.t_s, e.kind) for e in judge.decisive] == [(1.0, "INVALID")]
    assert judge.results(2.0)[0].detail == "no pose seen"


def test_samples_of_an_unjudged_vehicle_are_dropped() -> None:
    judge = Judge(build_oracles([use("geofence")], contexts("sim")))
    assert judge.pose(pose(1.0, "real", (99, 0, 0))) == ()
    assert judge.received(LinkSample(1.0, "nobody")) == ()


class Nothing:
    """A probe of an empty world."""

    def reaching(self, _: float) -> Self:
        return self

    def above(self, _: float) -> Self:
        return self

    def sweep(self, *_: object, **__: object) -> tuple[()]:
        return ()


@pytest.mark.parametrize("mode", ["sim", "wil", "real"])
def test_that_the_subject_touches_nothing_is_judged_always(mode: RunMode) -> None:
    flying = contexts(mode)
    seen = {name: replace(context, probe=Nothing()) for name, context in flying.items()}
    subject = next(iter(flying.values())).subject

    def of_contact(*uses: OracleUse) -> list[tuple[str, str, bool]]:
        found = [(o.name, o.vehicle, o.required) for o in build_oracles(uses, seen)]
        return [one for one in found if one[0] not in {"landed_always", "altitude"}]

    always = [("collision_always", subject, True)]
    assert of_contact(use("altitude", max_m=3)) == always
    assert of_contact(use("collision"))[0] == ("collision", subject, True)
    assert of_contact(use("collision", required=False))[0] == ("collision", subject, False)
    other = "real" if subject == "twin" else "twin"
    assert always[0] in of_contact(use("collision", vehicle=other))
    assert of_contact(use("collision"))[-1] != always[0]
    assert of_contact(use("collision", to="end"))[-1] != always[0]


@pytest.mark.parametrize(
    "weaker",
    [
        {"required": False},
        {"exclude": ("gate",)},
        {"from_": "goal"},
        {"to": "land"},
    ],
)
def test_no_use_of_collision_switches_off_the_collision_that_is_always_judged(
    weaker: dict[str, Any],
) -> None:
    flying = contexts("wil")
    seen = {name: replace(context, probe=Nothing()) for name, context in flying.items()}
    parameters = oracle_kinds()["collision"].parameters.model_construct(**weaker)
    uses = [OracleUse("collision", "collision", parameters)]

    def names(**options: bool) -> set[str]:
        return {o.name for o in build_oracles(uses, seen, **options) if o.required}

    assert "collision_always" in names()
    near = oracle_kinds()["clearance"].parameters.model_construct(min_m=0.1)
    uses = [OracleUse("clearance", "clearance", near)]
    assert "collision_always" in names()
    assert "collision_always" not in names(collision_always=False)


def test_contacts_excluded_from_the_collision_that_is_always_judged_are_named() -> None:
    uses = (use("collision", ground=("table", "pad")), use("clearance", min_m=0.1, ground=("pad",)))
    assert unjudged_contacts(uses, collision_always=True) == (
        "contact with table at takeoff and landing",
        "contact with pad at takeoff and landing",
    )
    assert unjudged_contacts(uses, collision_always=False) == ("collision_always",)
    assert unjudged_contacts((use("collision"),), collision_always=True) == ()
