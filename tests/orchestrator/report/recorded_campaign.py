"""A small campaign as our recorders leave it: a run that touched a gate, and one that passed."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.recording.judge_log_file import JudgeLogWriter
from wil_campaign.orchestrator.recording.mcap.mcap_settings import RecordingSettings
from wil_campaign.orchestrator.recording.mcap.mcap_writer import McapRecorder
from wil_campaign.orchestrator.recording.timestamps import VIRTUAL_EPOCH_S
from wil_campaign.orchestrator.recording.trajectory import TrajectoryRow, TrajectoryWriter
from wil_campaign.orchestrator.run_results.campaign_results import Summary, summarize
from wil_campaign.orchestrator.run_results.run_result import (
    MixingResult,
    Percentiles,
    RunResult,
    SyncResult,
)
from wil_campaign.orchestrator.state.run_log import RunLog
from wil_campaign.recipes.pipeline.mixture import Provenance
from wil_campaign.safety.fence.fence_values import plain_fence
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.model.oracle_results import EvidenceResult, OracleResult
from wil_campaign.safety.model.samples import PoseSample, Stage, StageSample
from wil_campaign.vehicles.readings import CameraReading, Source
from wil_campaign.vehicles.setpoints import VelocitySetpoint
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

HOSTILE = '<img src=x onerror="alert(1)"><script>alert(2)</script>\x1b[31m\u202e'
"""What a vehicle or an operator may say."""
TOUCHED_S = 4.0
GOAL_S = 2.0
END_S = 6.0
STAGES: tuple[tuple[Stage, float], ...] = (
    ("takeoff", 0.5),
    ("goal", GOAL_S),
    ("done", 5.0),
    ("end", END_S),
)
WORLD = {
    "schema": "wil/world/1",
    "origin": {"latitude_deg": 47.4, "longitude_deg": 8.5},
    "objects": {
        "gate": {
            "shape": {"gate": {"form": "square", "inner_size_m": 1.0, "bar_m": 0.1}},
            "pose": {"north_m": 2.0, "east_m": 0.0, "up_m": 1.2},
            "color": "orange",
            "exists_in": {"sim": "Wv", "wil": "Wv", "real": "W"},
        }
    },
}
CAMPAIGN = {
    "vehicles": {"real": {"sensors": {"camera": {"type": "camera", "mount": {"forward_m": 0.0}}}}},
    "goal": {"altitude_m": 1.2, "gates": ["gate"]},
    "cases": {"large": {"goal.altitude_m": 1.2}},
    "oracles": {"collision": {}, "waits": {"stl": "always[0,1.5] (up_m <= 1.0)"}},
    "repetitions": 1,
    "accept": {"large": {"wil": "1/1"}},
}
RECIPE = {"combine": [{"sensor": "camera", "transform": [{"register": {"pose": "real"}}]}]}
FENCE = Fence.box(north_m=(-1.0, 4.0), east_m=(-2.0, 2.0), up_m=(-0.5, 2.0))
INTRINSICS = Intrinsics(64, 48, 50.0, 50.0, 31.5, 23.5)


def touched() -> RunResult:
    """The run of mode wil: real touched the gate 2 s after the goal was given."""
    oracle = OracleResult(
        "collision", "real", True, "FAIL", 0.0, 0.0, "m", 0.0, TOUCHED_S, "touched gate.left"
    )
    evidence = EvidenceResult(
        signal="pose",
        vehicle="real",
        source="mocap",
        required=True,
        first_s=0.5,
        last_s=END_S,
        count=60,
        largest_gap_s=0.1,
        gap_at_s=1.0,
        limit_s=0.25,
        verdict="PASS",
    )
    return RunResult(
        case="large",
        mode="wil",
        rep=1,
        seed=7,
        verdict="FAIL",
        reason="real touched gate.left",
        also=(),
        required=True,
        duration_s=5.5,
        wall_s=1.0,
        oracles=(oracle,),
        sync=SyncResult(takeoff_skew_s=0.04),
        mixing=MixingResult(90, 0, 15.0, Percentiles(1.0, 2.0), Percentiles(5.0, 9.0)),
        evidence=(evidence,),
        decided_by="collision/real",
        note=HOSTILE,
    )


def too_high() -> RunResult:
    """The run of mode wil, had it been higher than `waits` allows from the goal on."""
    said = "up_m <= 1 is violated: 1.200 m against 1 m"
    oracle = OracleResult("waits", "real", True, "FAIL", 1.2, 1.0, "m", -0.2, GOAL_S, said)
    return replace(
        touched(),
        reason=f"waits of real failed: {said}",
        oracles=(oracle,),
        decided_by="waits/real",
    )


def passed() -> RunResult:
    """The run of mode sim."""
    oracle = OracleResult(
        "collision", "twin", True, "PASS", 0.3, 0.0, "m", 0.3, TOUCHED_S, "closest to gate.left"
    )
    return replace(
        touched(),
        mode="sim",
        verdict="PASS",
        reason="",
        oracles=(oracle,),
        mixing=None,
        decided_by="",
        note="",
    )


def summary_of_campaign() -> Summary:
    """The summary of both runs."""
    return summarize(
        [passed(), touched()],
        (),
        campaign="gate",
        clock="virtual",
        surrogate=True,
        real_kind="embedded",
        sensors={"camera": "rendered"},
    )


def write_campaign(folder: Path) -> Path:
    """Write the results folder of both runs, and return it."""
    folder.mkdir(parents=True)
    for run in (passed(), touched()):
        place = folder / f"{run.case}/{run.mode}/{run.rep}"
        place.mkdir(parents=True)
        _record(place, run)
        (place / "result.json").write_text(to_json(run))
    (folder / "summary.json").write_text(to_json(summary_of_campaign()))
    manifest = {
        "campaign": "gate",
        "description": HOSTILE,
        "seed": 1,
        "clock": "virtual",
        "started_utc": "2026-11-22T09:00:00Z",
        "versions": {"python": "3.11"},
        "files": {"gate.yaml": "sha256:00ff"},
        "runs": [{"run": f"large/{mode}/1"} for mode in ("sim", "wil")],
        "document": CAMPAIGN,
    }
    (folder / "campaign.json").write_text(json.dumps(manifest))
    return folder


def _record(place: Path, run: RunResult) -> None:
    vehicles = ("twin",) if run.mode == "sim" else ("real", "twin")
    with RunLog(path=place / "log.jsonl") as log:
        for stage, t_s in STAGES:
            log.write(t_s, "stage", stage=stage)
        log.write(3.0, "vehicle", vehicle=vehicles[0], kind="text", text=HOSTILE)
        log.write(3.5, "operator", kind="hold", who="anna <b>", reason=HOSTILE)
    _record_motion(place, vehicles)
    record_readings(place, run.mode)


def _record_motion(place: Path, vehicles: tuple[str, ...]) -> None:
    with (
        TrajectoryWriter(path=place / "trajectory.csv") as rows,
        JudgeLogWriter(path=place / "judged.msgpack") as judged,
    ):
        for k in range(int(END_S * 10) + 1):
            t_s = k / 10
            for vehicle in vehicles:
                east_m = 0.5 if vehicle == "real" else 0.0
                pose = Pose.of(max(0.0, t_s - GOAL_S), east_m, min(1.2, t_s))
                velocity = (1.0, 0.0, 0.0)
                judged.write(PoseSample(t_s, vehicle, pose, velocity))
                setpoint = VelocitySetpoint((0.8, 0.1, 0.0), 0.0)
                rows.write(
                    TrajectoryRow(
                        t_s, vehicle, "goal", "OFFBOARD", True, pose, velocity, pose, setpoint, "go"
                    )
                )
            for stage, at_s in STAGES:
                if at_s == t_s:
                    judged.write(StageSample(at_s, stage))


def record_readings(place: Path, mode: str, *, until_s: float = END_S) -> None:
    facts = {
        "mode": mode,
        "world": json.dumps(WORLD),
        "world_file": "world.yaml",
        "campaign": json.dumps(CAMPAIGN),
        "recipe": json.dumps(RECIPE),
        "fences": json.dumps({"real": plain_fence(FENCE), "twin": plain_fence(FENCE)}),
    }
    with McapRecorder(
        path=place / "run.mcap",
        epoch_s=VIRTUAL_EPOCH_S,
        clock="virtual",
        settings=RecordingSettings(),
        facts=facts,
    ) as recorder:
        for k in range(int(until_s * 10)):
            if mode != "sim":
                recorder.reading("camera", _image(k, "real"))
            recorder.reading("camera", _image(k, "twin"))
            if mode != "sim":
                mixed = _image(k, "mixed")
                provenance = Provenance(
                    real_seq=k,
                    real_t_s=k / 10,
                    twin_seq=k,
                    twin_t_s=k / 10,
                    skew_ms=1.5,
                    latency_ms=50.0,
                    registration_error_px=2.0,
                    given_real_seq=k,
                    given_twin_seq=k,
                )
                recorder.mixed("camera", mixed, provenance, now_s=mixed.arrived_s)


def _image(k: int, source: Source) -> CameraReading:
    """An image whose grey tells when it was exposed: 4 more each time."""
    grey: Any = np.full((48, 64, 3), 4 * k % 256, np.uint8)
    return CameraReading(
        t_s=k / 10,
        arrived_s=k / 10 + 0.05,
        seq=k,
        source=source,
        image_bgr=grey,
        intrinsics=INTRINSICS,
        rendered=True,
    )
