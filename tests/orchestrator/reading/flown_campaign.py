"""Results folders that nothing flew: each flight is a path, a verdict and a duration."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from wil_campaign.campaigns.values.acceptance import PassRequirement
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.recording.judge_log_file import JudgeLogWriter
from wil_campaign.orchestrator.recording.trajectory import TrajectoryRow, TrajectoryWriter
from wil_campaign.orchestrator.run_results.campaign_results import Summary, summarize
from wil_campaign.orchestrator.run_results.result_parts import FlownFirmware
from wil_campaign.orchestrator.run_results.run_result import RunResult, Stop, SyncResult
from wil_campaign.plugins.search.ledger import SearchLedger
from wil_campaign.safety.model.oracle_results import OracleResult, Verdict
from wil_campaign.safety.model.samples import PoseSample, StageSample
from wil_campaign.vehicles.setpoints import VelocitySetpoint
from wil_campaign.worlds.frames import Pose

GOAL_S, DONE_S = 2.0, 6.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """One flight. east_m: how far beside the straight way; lag_m_s: behind the command.

    margin_m: None where nothing came near.
    """

    case: str
    mode: str
    rep: int
    verdict: Verdict = "PASS"
    east_m: float = 0.0
    margin_m: float | None = 0.3
    duration_s: float = 10.0
    lag_m_s: float = 0.0
    command_m_s: float = 1.0
    seed: int | None = None
    firmware: tuple[FlownFirmware, ...] = ()

    @property
    def name(self) -> str:
        return f"{self.case}/{self.mode}/{self.rep}"

    def result(self) -> RunResult:
        subject = "twin" if self.mode == "sim" else "real"
        verdict: Literal["PASS", "FAIL"] = "PASS" if self.verdict == "PASS" else "FAIL"
        oracle = OracleResult(
            "collision", subject, True, verdict, self.margin_m, 0.0, "m", self.margin_m, 4.0
        )
        return RunResult(
            case=self.case,
            mode=self.mode,
            rep=self.rep,
            seed=100 + self.rep if self.seed is None else self.seed,
            verdict=self.verdict,
            reason="" if self.verdict == "PASS" else "real touched gate.left",
            also=(),
            required=True,
            duration_s=self.duration_s,
            wall_s=1.0,
            oracles=(oracle,),
            sync=SyncResult(),
            mixing=None,
            firmware=self.firmware,
        )


def flights(
    case: str, mode: str, verdicts: str, easts_m: Sequence[float] = (), **more: Any
) -> list[Flight]:
    """Return a flight for each letter: P for PASS, F for FAIL, I for INVALID."""
    words: dict[str, Verdict] = {"P": "PASS", "F": "FAIL", "I": "INVALID"}
    spread = list(easts_m) or [0.0] * len(verdicts)
    return [
        Flight(
            case=case,
            mode=mode,
            rep=number,
            verdict=words[letter],
            east_m=east_m,
            margin_m=round(0.3 - abs(east_m), 6),
            duration_s=10.0 + east_m,
            **more,
        )
        for number, (letter, east_m) in enumerate(zip(verdicts, spread, strict=True), 1)
    ]


def summary_of(
    given: Sequence[Flight],
    name: str = "gate",
    clock: str = "virtual",
    *,
    stopped: Stop | None = None,
    broken: bool | None = False,
    requirements: Sequence[PassRequirement] = (),
) -> Summary:
    return summarize(
        [one.result() for one in given],
        requirements,
        campaign=name,
        clock="virtual" if clock == "virtual" else "wall",
        surrogate=True,
        real_kind="embedded",
        sensors={},
        stopped=stopped,
        broken=broken,
    )


def write_flown(
    folder: Path,
    given: Sequence[Flight],
    *,
    name: str = "gate",
    started_utc: str = "2026-11-20T10:00:00Z",
    version: str = "1.0",
    clock: str = "virtual",
    document: Mapping[str, object] | None = None,
    with_motion: bool = True,
    documents: Callable[[Flight], str] = lambda _: "sha256:0",
    stopped: Stop | None = None,
    broken: bool | None = False,
    requirements: Sequence[PassRequirement] | None = None,
    planned: int = 0,
    host: str = "here",
) -> Path:
    """Write the results folder of flights, and return it.

    requirements: None writes the manifest of an earlier version, which has none. planned: how many
    repetitions the manifest has at least.
    """
    folder.mkdir(parents=True)
    for one in given:
        place = folder / one.name
        place.mkdir(parents=True)
        (place / "result.json").write_text(to_json(one.result()))
        if with_motion:
            _write_motion(place, one)
    summary = summary_of(
        given, name, clock, stopped=stopped, broken=broken, requirements=requirements or ()
    )
    (folder / "summary.json").write_text(to_json(summary))
    cells = {(one.case, one.mode): one for one in given}.values()
    more = [replace(cell, rep=rep) for cell in cells for rep in range(1, planned + 1)]
    runs = {one.name: one for one in (*given, *more)}
    manifest: dict[str, object] = {
        "campaign": name,
        "started_utc": started_utc,
        "clock": clock,
        "versions": {"wil-campaign": version},
        "files": {"gate.yaml": "sha256:0"},
        "host": {"name": host, "machine": "x86_64", "cores": 2},
        "runs": [
            {"run": name, "seed": run.result().seed, "documents": documents(run)}
            for name, run in runs.items()
        ],
        "document": dict(document or {"campaign": name}),
    }
    if requirements is not None:
        manifest["requirements"] = [asdict(requirement) for requirement in requirements]
    (folder / "campaign.json").write_text(json.dumps(manifest))
    return folder


def write_control(folder: Path, control: RunResult) -> None:
    """Write a flown control into a results folder."""
    name = f"{control.case}/{control.mode}/{control.rep}"
    (folder / name).mkdir(parents=True)
    (folder / name / "result.json").write_text(to_json(control))
    for document, key, entry in (
        ("campaign.json", "runs", {"run": name, "seed": control.seed, "documents": "x"}),
        ("summary.json", "controls", json.loads(to_json(control))),
    ):
        content = json.loads((folder / document).read_text())
        content[key].append(entry)
        (folder / document).write_text(json.dumps(content))


def write_summary_anew(folder: Path) -> None:
    """Write what the results of a folder's runs say into its summary, after they were changed."""
    summary = json.loads((folder / "summary.json").read_text())
    summary["runs"] = [
        json.loads((folder / f"{run['case']}/{run['mode']}/{run['rep']}/result.json").read_text())
        for run in summary["runs"]
    ]
    (folder / "summary.json").write_text(json.dumps(summary))


def write_searched(home: Path, *, started_utc: str) -> Path:
    """Write the folder of a search with one batch beneath a campaign's results, and return it."""
    folder = home / "search" / started_utc.replace(":", "").replace("-", "")
    batch = folder / "flights" / "0001"
    write_flown(batch, flights("v1", "sim", "PF"), started_utc=started_utc, with_motion=False)
    (folder / "campaign.json").write_bytes((batch / "campaign.json").read_bytes())
    SearchLedger.new(folder, at_once=1)
    return folder


def _write_motion(place: Path, flight: Flight) -> None:
    vehicle = "twin" if flight.mode == "sim" else "real"
    with (
        TrajectoryWriter(path=place / "trajectory.csv") as rows,
        JudgeLogWriter(path=place / "judged.msgpack") as judged,
    ):
        for k in range(71):
            t_s = k / 10
            speed_m_s = flight.command_m_s - flight.lag_m_s
            pose = Pose.of(max(0.0, t_s - GOAL_S), flight.east_m, 1.2)
            judged.write(PoseSample(t_s, vehicle, pose, (speed_m_s, 0.0, 0.0)))
            setpoint = VelocitySetpoint((flight.command_m_s, 0.0, 0.0), 0.0)
            row = (t_s, vehicle, "goal", "OFFBOARD", True, pose, (speed_m_s, 0.0, 0.0), pose)
            rows.write(TrajectoryRow(*row, setpoint, ""))
            if t_s == GOAL_S:
                judged.write(StageSample(t_s, "goal"))
            if t_s == DONE_S:
                judged.write(StageSample(t_s, "done"))
