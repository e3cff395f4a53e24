"""The tape of a judge: it reads back exactly, and judges as the flight was judged."""

import io
import math
from collections.abc import Mapping

import msgpack  # type: ignore[import-untyped]  # ships no types
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.safety.oracles.oracle_rigs import FENCE, SCENE
from wil_campaign.safety.evaluation.judge import Judge, OracleUse, build_oracles
from wil_campaign.safety.evaluation.judge_log import (
    ActorPose,
    ClockTick,
    JudgeLogError,
    JudgeLogPacker,
    LoggedSample,
    LoggedWorldEvent,
    judge_from_log,
    read_judge_log,
)
from wil_campaign.safety.evidence.evidence import Evidence
from wil_campaign.safety.evidence.terms import SignalTerms
from wil_campaign.safety.fence.areas import Circle, Polygon
from wil_campaign.safety.fence.fence_values import plain_fence
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.model.samples import (
    DoubtSample,
    DropOutSample,
    FenceSample,
    GroundSpeedSample,
    HeadingSample,
    LinkSample,
    PoseSample,
    ReportSample,
    Stage,
    StageSample,
    StateSample,
)
from wil_campaign.safety.oracles.gates import gates_of
from wil_campaign.safety.oracles.oracle import OracleContext
from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.vehicles.embedded.physics.airframe import Airframe
from wil_campaign.vehicles.embedded.physics.contact_world import contact_box_of
from wil_campaign.worlds.clearance.clearance import ClearanceProbe
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.scene import Scene
from wil_campaign.worlds.scene.track import RunHistory

BODY = contact_box_of(Airframe())
USES: tuple[tuple[str, dict[str, object]], ...] = (
    ("collision", {}),
    ("clearance", {"min_m": 0.3}),
    ("reached", {}),
    ("reached_position", {"tolerance_m": 0.5}),
    ("time_limit", {"limit_s": 4.0}),
    ("geofence", {}),
    ("altitude", {"min_m": 0.5, "max_m": 2.0}),
    ("vehicle_fault", {}),
    ("link", {"max_gap_s": 0.5}),
    ("landed", {}),
    ("touchdown", {"max_m_s": 1.0}),
    ("twin_divergence", {"max_m": 1.0, "required": True}),
    ("area", {"keep": {"box": {"north_m": (-1, 4), "east_m": (-1, 1), "up_m": (-1, 2)}}}),
    ("distance", {"object": "gate", "min_m": 0.2, "max_m": 3.0}),
    ("encounter", {"object": "gate", "within_m": 1.0, "for_s": 0.5}),
    ("speed", {"max_m_s": 2.0}),
    ("attitude", {"max_tilt_deg": 30.0}),
    ("estimator", {"max_unsound_s": 0.3}),
    ("battery", {"min_percent": 50.0}),
    ("modes", {"allowed": ("guided", "hold"), "max_changes": 2}),
    (
        "stl",
        {
            "stl": "always (armed -> eventually[0,2] (clearance_m > 0.1 or silence_s < 1)) "
            "and always (fence_margin_m > -1)",
            "from": "takeoff",
            "fail_fast": True,
        },
    ),
)

FENCES = (
    Fence.box(north_m=(-3, 3), east_m=(-3, 3), up_m=(-1, 3)),
    Fence(
        inclusions=[Circle((0.0, 1.0), 2.5)],
        exclusions=[Polygon(((0.0, 0.0), (0.0, 1.0), (1.0, 1.0)))],
        ceiling_up_m=2.0,
    ),
)
numbers = st.floats(-4.0, 4.0)
angles = st.floats(-1.0, 1.0)
vehicles = st.sampled_from(["real", "twin"])
texts = st.none() | st.text(max_size=5)
STAGES: tuple[Stage, ...] = ("takeoff", "at_height", "goal", "done", "land", "landed", "end")

SIGNALS = ("pose", "battery")


@st.composite
def judge_logs(draw: st.DrawFn) -> list[LoggedSample]:
    """Samples of a flight in the order of their times, its stages in their order."""
    t_s, stages = 0.0, list(STAGES)
    taped: list[LoggedSample] = []
    for _ in range(draw(st.integers(0, 30))):
        t_s += draw(st.floats(0.0, 1.0))
        kind = draw(st.integers(0, 11))
        vehicle = draw(vehicles)
        if kind <= 3:
            taped.append(draw_pose(draw, t_s, vehicle))
        elif kind <= 5:
            taped.append(draw_state(draw, t_s, vehicle))
        elif kind == 6:
            taped.append(LinkSample(t_s, vehicle))
        elif kind == 7:
            taped.append(ClockTick(t_s))
        elif kind >= 10:
            taped.append(draw_evidence(draw, t_s, vehicle))
        elif kind == 8 and draw(st.booleans()):
            taped.append(FenceSample(t_s, vehicle, draw(st.sampled_from(FENCES))))
        elif kind == 8:
            taped.append(LoggedWorldEvent(t_s, draw(st.text(max_size=4))))
        elif stages:
            taped.append(StageSample(t_s, stages.pop(0), draw(st.none() | vehicles)))
    return taped


def draw_evidence(draw: st.DrawFn, t_s: float, vehicle: str) -> LoggedSample:
    signal = draw(st.sampled_from((*SIGNALS, "camera")))
    kind = draw(st.integers(0, 4))
    if kind == 4:
        turned_rad = draw(st.floats(-math.pi, math.pi))
        return HeadingSample(t_s, vehicle, "gyroscopes", turned_rad, draw(st.floats(0.0, 0.2)))
    if kind == 3:
        return DropOutSample(t_s, vehicle)
    if kind == 2:
        accuracy_m_s = draw(st.none() | st.floats(0.01, 2.0))
        return GroundSpeedSample(t_s, vehicle, "gps", draw(st.floats(0.0, 20.0)), accuracy_m_s)
    if kind:
        return ReportSample(t_s, vehicle, signal)
    return DoubtSample(t_s, vehicle, signal, "recipe", "it is not there")


def draw_pose(draw: st.DrawFn, t_s: float, vehicle: str) -> PoseSample:
    bad = draw(st.integers(0, 30)) == 0
    north_m = math.nan if bad else draw(numbers)
    place = (north_m, draw(numbers), -abs(draw(numbers)))
    half = draw(angles)
    q_wxyz = (math.cos(half), math.sin(half), 0.0, 0.0)
    velocity = (draw(numbers), draw(numbers), 0.0)
    return PoseSample(t_s, vehicle, Pose(place, q_wxyz), velocity)


def draw_state(draw: st.DrawFn, t_s: float, vehicle: str) -> StateSample:
    return StateSample(
        t_s,
        vehicle,
        draw(st.booleans()),
        draw(st.sampled_from(FlightMode)),
        draw(st.sampled_from(["HOLD", "OFFBOARD"])),
        draw(st.none() | st.booleans()),
        draw(texts),
        draw(st.none() | st.floats(0.0, 1.0)),
        draw(st.none() | st.floats(0.0, 20.0)),
        draw(texts),
    )


def judge_of(events: Mapping[str, float]) -> Judge:
    uses = [
        OracleUse(kind, kind, oracle_kinds()[kind].parameters.model_validate(given))
        for kind, given in USES
    ]
    contexts = {
        vehicle: OracleContext(
            mode="wil",
            subject="real",
            vehicle=vehicle,
            probe=ClearanceProbe(SCENE, BODY),
            ground_down_m=0.0,
            things=SCENE.names,
            probe_of=lambda name: ClearanceProbe(Scene((SCENE[name],)), BODY, within_m=1e6),
            gates=gates_of(SCENE),
            route=("gate", "ring"),
            target_ned_m=(1, 0, -1),
            fence=FENCE,
            events=events,
        )
        for vehicle in ("real", "twin")
    }
    signals = [
        SignalTerms(
            signal=signal,
            vehicle=vehicle,
            source="mocap",
            limit_s=0.3,
            required=vehicle == "real",
            over_link=signal == "battery",
        )
        for vehicle in ("real", "twin")
        for signal in SIGNALS
    ]
    return Judge(build_oracles(uses, contexts), Evidence(signals))


def packed(taped: list[LoggedSample]) -> bytes:
    packer = JudgeLogPacker()
    return packer.header() + b"".join(packer.pack(sample) for sample in taped)


def feed_evidence(
    judge: Judge, sample: GroundSpeedSample | HeadingSample | ReportSample | DoubtSample
) -> None:
    match sample:
        case HeadingSample():
            judge.heading(sample)
        case GroundSpeedSample():
            judge.ground_speed(sample)
        case ReportSample():
            judge.report(sample)
        case DoubtSample():
            judge.doubt(sample)


def feed(judge: Judge, events: dict[str, float], sample: LoggedSample) -> None:
    """Feed one sample as a flight does."""
    match sample:
        case PoseSample():
            judge.pose(sample)
        case StateSample():
            judge.state(sample)
        case LinkSample():
            judge.received(sample)
        case GroundSpeedSample() | HeadingSample() | ReportSample() | DoubtSample():
            feed_evidence(judge, sample)
        case StageSample():
            judge.stage(sample)
        case DropOutSample():
            judge.drop_out(sample)
        case ClockTick(t_s):
            judge.tick(t_s)
        case FenceSample():
            judge.fence(sample)
        case LoggedWorldEvent(t_s, name):
            events[name] = t_s


@settings(max_examples=40, deadline=None)
@given(judge_logs())
def test_judging_a_judge_log_is_judging_the_flight(taped: list[LoggedSample]) -> None:
    events: dict[str, float] = {}
    online = judge_of(events)
    for sample in taped:
        feed(online, events, sample)
    again = RunHistory()
    offline = judge_of(again)
    played = judge_from_log(read_judge_log(io.BytesIO(packed(taped))), offline, again)
    reached = {s.stage: s.t_s for s in taped if isinstance(s, StageSample)}
    assert (played.end_s, played.stages) == (reached.get("end"), reached)
    assert offline.results(99.0) == online.results(99.0)
    assert offline.flags == online.flags
    assert offline.decisive == online.decisive
    assert offline.evidence == online.evidence
    assert again == events


def test_every_oracle_is_in_the_test_of_the_judge_log() -> None:
    assert {kind for kind, _ in USES} == set(oracle_kinds()), "USES above names each oracle"


@settings(max_examples=50, deadline=None)
@given(judge_logs())
def test_a_judge_log_reads_back_what_was_written_and_a_cut_one_as_far_as_it_goes(
    taped: list[LoggedSample],
) -> None:
    whole = packed(taped)
    assert shown(list(read_judge_log(io.BytesIO(whole)))) == shown(taped)
    if taped:
        cut = list(read_judge_log(io.BytesIO(whole[:-1])))
        assert shown(cut) == shown(taped[:-1])


def shown(taped: list[LoggedSample]) -> list[str]:
    """Return samples as text: one that is not finite equals none, not even itself."""
    return [
        f"{s.t_s} {s.vehicle} {plain_fence(s.fence)}" if isinstance(s, FenceSample) else repr(s)
        for s in taped
    ]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "does not begin with wil/judged/2"),
        (b"t_s,vehicle\n", "does not begin with wil/judged/2"),
        (packed([]) + msgpack.packb(["tick", "soon"]), "no sample before byte"),
        (packed([]) + msgpack.packb(["stage", 1.0, "lunch", None]), "no sample before byte"),
        (packed([]) + msgpack.packb(["state", 1.0, "real"]), "no sample before byte"),
        (packed([]) + msgpack.packb(5), "no sample before byte"),
        (packed([]) + b"\xc1\xc1", "no sample before byte"),
    ],
)
def test_a_file_that_is_no_judge_log_is_refused(data: bytes, said: str) -> None:
    with pytest.raises(JudgeLogError, match=said):
        list(read_judge_log(io.BytesIO(data)))


def test_where_an_actor_flew_reads_back_into_the_history() -> None:
    """What is judged again meets the object where the vehicle was, to the last bit."""
    pose = Pose((1.1, -0.2, -0.3), (0.6, 0.0, 0.8, 0.0))
    taped: list[LoggedSample] = [ActorPose(0.1, "intruder", pose, (0.1, 0.2, -0.3))]
    assert list(read_judge_log(io.BytesIO(packed(taped)))) == taped
    history = RunHistory()
    judge_from_log(taped, judge_of(history), history)
    assert history.tracks["intruder"].pose_at(0.1) == pose
