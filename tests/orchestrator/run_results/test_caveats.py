"""A green says what it has to be read with: fences changed in flight, oracles that only report."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.statistics.sequential_test import SequentialTest
from wil_campaign.campaigns.values.acceptance import PassRequirement, PassShare
from wil_campaign.foundation.files.document_writer import to_json, write_atomically
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.cli.verdict_table import conclusion_lines
from wil_campaign.orchestrator.run_results.campaign_results import Summary, summarize
from wil_campaign.orchestrator.run_results.caveats import campaign_caveats
from wil_campaign.orchestrator.run_results.junit import junit_xml
from wil_campaign.orchestrator.run_results.result_parts import (
    ArmingStep,
    DropOut,
    ExternalResult,
    SourceResult,
    TwinResult,
)
from wil_campaign.orchestrator.run_results.result_reader import read_result
from wil_campaign.orchestrator.run_results.run_result import (
    CombinationResult,
    FenceChange,
    MixingResult,
    Percentiles,
    RunResult,
    ShownResult,
    SlowAutonomy,
    SyncResult,
)
from wil_campaign.safety.model.oracle_results import OracleResult, Verdict

CHANGED = FenceChange(12.5, "cli:anna", ("real", "twin"))


def run(rep: int = 1, *, mode: str = "wil", verdict: Verdict = "PASS", **more: Any) -> RunResult:
    return RunResult(
        case="large",
        mode=mode,
        rep=rep,
        seed=5,
        verdict=verdict,
        reason="" if verdict == "PASS" else "why",
        also=(),
        required=True,
        duration_s=12.5,
        wall_s=1.0,
        **{"oracles": (), "sync": SyncResult(), "mixing": None, **more},
    )


def oracle(vehicle: str, *, required: bool = False, passes: bool = False) -> OracleResult:
    verdict = "PASS" if passes else "FAIL"
    return OracleResult("reached", vehicle, required, verdict, None, 0.1, "m", None, None)  # type: ignore[arg-type]  # one of both


def summary(*runs: RunResult) -> Summary:
    count = sum(one.mode == "wil" for one in runs)
    return summarize(
        runs,
        (PassRequirement("large", "wil", PassShare(count, count)),),
        campaign="gate",
        clock="virtual",
        surrogate=False,
        real_kind="hardware",
        sensors={},
    )


def caveat_lines(*runs: RunResult) -> list[str]:
    return [line.plain for line in conclusion_lines(summary(*runs))]


def properties(*runs: RunResult) -> dict[str, str]:
    root = ET.fromstring(junit_xml(summary(*runs), ()))  # noqa: S314 - our own document
    return {one.attrib["name"]: one.attrib["value"] for one in root.iter("property")}


def test_a_vehicle_that_kept_the_parameters_of_its_run_is_named() -> None:
    def step(restored: bool | None) -> ArmingStep:
        return ArmingStep("parameters", "real", 1.0, True, "RTL_ALT 172", restored=restored)

    left = (step(False), step(False))
    runs = [run(1, before_arming=(step(True),)), *(run(n, before_arming=left) for n in (2, 3))]
    text = "real kept those of its run, until the next start restores them"
    assert campaign_caveats(runs) == [
        f"parameters or fence not restored: {text} (large wil, 2 runs)"
    ]


def test_a_fence_changed_in_flight_is_reported_with_the_verdict() -> None:
    runs = [run(1, fence_changes=(CHANGED, CHANGED)), run(2), run(3, fence_changes=(CHANGED,))]
    assert caveat_lines(*runs) == [
        "fence changed in flight: real and twin by cli:anna (large wil, 2 runs)",
        "accepted; fence changed in flight by cli:anna",
    ]
    assert properties(*runs) == {"fence_changed": "real and twin by cli:anna (large wil, 2 runs)"}


def test_a_changed_fence_is_reported_where_a_campaign_is_not_accepted_too() -> None:
    last = caveat_lines(run(verdict="FAIL", fence_changes=(CHANGED,)))[-1]
    assert last == "not accepted; fence changed in flight by cli:anna"


def test_a_changed_fence_names_its_vehicles_and_who_changed_it() -> None:
    of_twin = FenceChange(3.0, "mqtt:ben", ("twin",))
    assert caveat_lines(
        run(fence_changes=(CHANGED,)), run(mode="sim", fence_changes=(of_twin,))
    ) == [
        "fence changed in flight: real and twin by cli:anna (large wil, 1 run)",
        "fence changed in flight: twin by mqtt:ben (large sim, 1 run)",
        "accepted; fence changed in flight by cli:anna, mqtt:ben",
    ]


def test_a_result_with_a_changed_fence_is_read_back_as_written(tmp_path: Path) -> None:
    result = run(fence_changes=(CHANGED,))
    write_atomically(tmp_path / "result.json", to_json(result))
    assert read_result(tmp_path / "result.json") == result


def test_an_oracle_that_only_reports_and_failed_is_reported() -> None:
    failed = (oracle("real"), oracle("twin"))
    runs = [run(1, oracles=failed), run(2), run(1, mode="sim", oracles=(oracle("twin"),))]
    text = "reached (large wil, 1 run; large sim, 1 run)"
    assert caveat_lines(*runs) == [
        f"reported only, and failed: {text}",
        "accepted; reported only, and failed: reached",
    ]
    assert properties(*runs) == {"reported_failed": text}


def test_a_campaign_that_is_not_accepted_tells_it_beneath_the_table_alone() -> None:
    said = caveat_lines(run(1, oracles=(oracle("real"),)), run(2, verdict="FAIL"))
    assert said[-3:] == [
        "reported only, and failed: reached (large wil, 1 run)",
        "1 of the 2 required runs passed: large/wil is 1/2 (needs 2/2)",
        "not accepted",
    ]


@pytest.mark.parametrize(
    "silent",
    [
        run(oracles=(oracle("twin"),)),
        run(oracles=(oracle("real", passes=True),)),
        run(verdict="FAIL", oracles=(oracle("real"), oracle("real", required=True))),
    ],
    ids=["the twin beside the real one", "it passed", "the run failed anyway"],
)
def test_oracles_without_news_are_not_reported(silent: RunResult) -> None:
    assert not [line for line in caveat_lines(silent) if "reported only" in line]
    assert properties(silent) == {}


@pytest.mark.usefixtures("forked_workers")
def test_a_flown_campaign_says_what_failed_and_was_only_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_hover(tmp_path)
    low = "oracles.low={use: altitude, max_m: 0.3, required: false}"
    assert main(["run", str(path), "--out", str(tmp_path / "out"), "--set", low]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "reported only, and failed: low (default sim, 2 runs)" in said
    assert "accepted; " in said


def test_a_twin_that_dropped_out_is_reported_with_what_passed() -> None:
    dropped_out = DropOut(17.5, "nothing received from twin for 3 s")
    left = TwinResult("free", 0.1, 0.2, 0.3, 10.0, dropped_out)
    runs = [run(twin=left), run(2), run(3, verdict="FAIL", twin=left)]
    # Of a failed run too: it tells why the picture of the flight ends.
    text = "nothing received from twin for 3 s (large wil, 2 runs)"
    assert f"the twin dropped out: {text}" in caveat_lines(*runs)
    assert properties(*runs)["twin_dropped_out"] == text


@pytest.mark.parametrize(
    ("durations_s", "is_said"),
    [((12.5, 12.5), True), ((12.5, 12.6), False), ((12.5,), False)],
    ids=["equal", "unequal", "undecided"],
)
def test_a_pass_rate_decided_by_equal_runs_is_reported(
    durations_s: tuple[float, ...], is_said: bool
) -> None:
    test = SequentialTest(at_least=0.9, against=0.2, most=5)
    found = summarize(
        [replace(run(rep), duration_s=each) for rep, each in enumerate(durations_s, start=1)],
        (PassRequirement("large", "wil", PassShare(5, 5), test),),
        campaign="gate",
        clock="virtual",
        surrogate=False,
        real_kind="hardware",
        sensors={},
        caveats=("of the file",),
    )
    text = (
        "large/wil: the 2 runs that decided its pass rate measured the same, and are one "
        "observation: let something vary with the seed, such as wind or noise"
    )
    assert found.caveats == (("of the file", text) if is_said else ("of the file",))
    assert (text in [line.plain for line in conclusion_lines(found)]) is is_said


def combination(name: str = "camera", **more: Any) -> CombinationResult:
    none = Percentiles(None, None)
    return CombinationResult(
        name=name,
        sensor="camera",
        publish=("real",),
        frames=20,
        dropped={},
        faults={},
        rate_hz=15.0,
        skew_ms=none,
        latency_ms=none,
        **more,
    )


def mixed(*combinations: CombinationResult) -> MixingResult:
    none = Percentiles(None, None)
    return MixingResult(
        frames=20,
        dropped=0,
        rate_hz=15.0,
        skew_ms=none,
        latency_ms=none,
        combinations=combinations,
        not_measured=combinations[0].not_measured,
    )


def test_each_combination_that_was_not_measured_is_reported_with_its_reason() -> None:
    mixing = mixed(
        combination(frames_measured=9),
        combination("rear", not_measured="images from a file have no camera pose"),
        combination("points", frames_measured=7, not_measured="no reference pose of the exposure"),
    )
    runs = [run(mixing=mixing), run(2, verdict="FAIL", mixing=mixing)]
    texts = [
        "rear: images from a file have no camera pose (large wil, 1 run)",
        "points, in part: no reference pose of the exposure (large wil, 1 run)",
    ]
    said = "virtual objects in the mixture not measured"
    assert caveat_lines(*runs)[1:3] == [f"{said}: {text}" for text in texts]
    assert properties(*runs)["mixture_not_measured"] == ", ".join(texts)


def test_pictures_that_were_perceived_on_trust_are_reported_of_passed_runs() -> None:
    """A mixture is measured itself, or its own caveat says why it is not."""
    trusted = SourceResult("twin", "camera", "rendered", 90, 0, 0, 0, 0, "", 0, "it marks no gate")
    outside = ExternalResult((trusted, replace(trusted, sensor="rear", not_measured="")))
    runs = [
        run(mode="sim", outside=outside),
        run(2, mode="sim", outside=outside, verdict="FAIL"),
        run(outside=outside, mixing=mixed(combination())),
    ]
    said = "simulator's images not compared with the world: twin camera: it marks no gate"
    assert f"{said} (large sim, 1 run)" in caveat_lines(*runs)
    assert caveat_lines(*runs)[-1].endswith("not compared with the world: twin camera")
    text = "twin camera: it marks no gate (large sim, 1 run)"
    assert properties(*runs) == {"simulator_not_compared": text}


def test_a_virtual_object_in_view_that_no_mixture_showed_is_reported() -> None:
    """Left out by name, or in view in too few frames to count; another sensor may show it."""
    camera = combination(
        shown={"gate": ShownResult(9, 9), "pillar": ShownResult(1, 0), "far": ShownResult(0, 0)},
        not_mixed={"intruder": 12, "wall": 3},
    )
    lidar = combination("lidar", shown={"wall": ShownResult(8, 8), "gate": ShownResult(3, 0)})
    runs = [run(mixing=mixed(camera, lidar)), run(2, verdict="FAIL", mixing=mixed(camera))]
    texts = ["intruder (large wil, 1 run)", "pillar (large wil, 1 run)"]
    said = "virtual object in view, and in no mixture"
    assert caveat_lines(*runs)[1:3] == [f"{said}: {text}" for text in texts]
    assert caveat_lines(*runs)[-1] == "not accepted; in view, and in no mixture: intruder, pillar"
    assert properties(*runs) == {"mixture_without": ", ".join(texts)}


def test_a_named_object_that_no_mixture_had_in_view_is_reported() -> None:
    unseen = replace(mixed(combination()), unseen=("gate",))
    runs = [run(mixing=unseen), run(2, verdict="FAIL", mixing=unseen)]
    assert "virtual object never in view: gate (large wil, 1 run)" in caveat_lines(*runs)
    assert caveat_lines(*runs)[-1] == "not accepted; never in view: gate"


def test_synthesised_readings_are_named_beside_the_verdict() -> None:
    made = replace(
        summary(run()), sensors={"camera": "live", "lidar": "synthesised", "gps": "synthesised"}
    )
    why = "computed from the pose of the real vehicle and its world, not measured"
    assert [line.plain for line in conclusion_lines(made)] == [
        f"synthesised readings: lidar, gps ({why})",
        "accepted; synthesised readings: gps, lidar",
    ]
    assert conclusion_lines(replace(made, sensors={"camera": "rendered"}))[-1].plain == "accepted"


def test_an_autonomy_slower_than_real_time_qualifies_a_pass() -> None:
    slow, slower = SlowAutonomy("real", 9.0, 6.0), SlowAutonomy("real", 12.25, 6.0)
    lines = caveat_lines(run(1, slow=(slow,)), run(2, slow=(slower,)), run(3))
    (caveat,) = [line for line in lines if line.startswith("slower than real time: ")]
    assert caveat == (
        "slower than real time: the autonomy of real needed 12.2 s on this machine for its calls "
        "and would have had 6.0 s: on the wall clock it fails (large wil, 2 runs)"
    )
    assert "slower than real time: real" in lines[-1]
    assert not any(
        "slower" in caveat_line for caveat_line in caveat_lines(run(verdict="FAIL", slow=(slow,)))
    )


def test_every_caveat_beneath_the_table_is_a_property_of_junit_once() -> None:
    left = ArmingStep("parameters", "real", 1.0, True, "RTL_ALT 172", restored=False)
    unseen = replace(mixed(combination()), unseen=("gate",))
    runs = [
        run(
            before_arming=(left,),
            fence_changes=(CHANGED,),
            mixing=unseen,
            slow=(SlowAutonomy("real", 9.0, 6.0),),
            unmoved=("walker",),
        )
    ]
    said = ", ".join(properties(*runs).values())
    lines = campaign_caveats(runs)
    assert len(lines) > 4
    assert [said.count(line.partition(": ")[2]) for line in lines] == [1] * len(lines)


def test_synthesised_readings_are_a_property_of_junit() -> None:
    made = replace(summary(run()), sensors={"lidar": "synthesised"})
    assert b"synthesised readings: lidar" in junit_xml(made, ())


@pytest.mark.parametrize(
    ("flown", "last"),
    [
        (
            {"before_arming": (ArmingStep("fence", "real", 1.0, True, "", restored=False),)},
            "parameters or fence not restored: real",
        ),
        (
            {"mixing": mixed(combination(not_measured="no reference pose of the exposure"))},
            "mixture not measured: camera",
        ),
        (
            {"mixing": mixed(combination(not_bounded="no covariance"))},
            "registration error not bounded: camera",
        ),
        (
            {"twin": TwinResult("follow", 0.1, 0.2, 0.3, 1.0, DropOut(17.5, "nothing received"))},
            "the twin dropped out: large wil",
        ),
    ],
)
def test_a_caveat_of_a_passed_run_stands_in_the_last_line(flown: dict[str, Any], last: str) -> None:
    assert caveat_lines(run(**flown))[-1] == f"accepted; {last}"
