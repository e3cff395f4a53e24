"""Pass rates, tests between modes and the gap of results folders that nothing flew."""

import json
import statistics
from pathlib import Path

import pytest

from tests.orchestrator.reading.flown_campaign import Flight, flights, write_flown
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.recording.judge_log_file import JudgeLogWriter
from wil_campaign.orchestrator.recording.mcap.mcap_settings import RecordingSettings
from wil_campaign.orchestrator.recording.mcap.mcap_writer import McapRecorder
from wil_campaign.orchestrator.report.campaign_report import write_report
from wil_campaign.plugins.statistics.gap.gap import ALL_CASES, CampaignGap, GapFigure
from wil_campaign.plugins.statistics.pass_rates import pass_rates
from wil_campaign.plugins.statistics.study import Study
from wil_campaign.plugins.statistics.study_section import study_section
from wil_campaign.plugins.statistics.study_tables import (
    gap_rows,
    result_rows,
    speed_rows,
    study_statements,
)
from wil_campaign.plugins.statistics.study_text import study_text
from wil_campaign.safety.evaluation.judge_log import ActorPose, LoggedWorldEvent
from wil_campaign.safety.model.samples import PoseSample, StageSample
from wil_campaign.worlds.frames import Pose

Capture = pytest.CaptureFixture[str]
SPREAD = (-0.02, -0.01, 0.0, 0.01, 0.02)
ORDERS = {"real": (0, 1, 2, 3, 4), "wil": (2, 4, 1, 0, 3), "sim": (4, 0, 3, 1, 2)}
"""Of a mode's flights by their spread: flights of one seed in two modes have little in common."""


def table_one() -> list[Flight]:
    """The paper's Table I; each flight measured a little differently."""
    counts = {
        "gate-large": ("PPPPP", "PPPPP", "PPPPP"),
        "gate-small": ("PPPPP", "PFFFF", "PF"),
        "follow-walk": ("PPPPP", "PPPPF", "FFFFF"),
        "follow-run": ("PPPPP", "PPPPF", "PFFFF"),
        "avoid-slow": ("PPPPP", "PPPPP", "PPPPP"),
        "avoid-fast": ("PPPPP", "PPFFF", ""),
    }
    return [
        flight
        for case, verdicts in counts.items()
        for mode, letters in zip(("sim", "wil", "real"), verdicts, strict=True)
        for flight in flights(case, mode, letters, SPREAD[: len(letters)])
    ]


def study_of(folder: Path) -> Study:
    return Study.read(folder)


def figure(gap: CampaignGap, measure: str, case: str) -> GapFigure:
    return next(one for one in gap.figures if (one.measure, one.case) == (measure, case))


def test_the_papers_table_holds_pooled_and_not_per_case() -> None:
    rates = pass_rates([one.result() for one in table_one()])
    tests = {(test.case, test.one, test.other): test.p for test in rates.tests}
    pooled = tests["", "sim", "wil"]
    assert pooled is not None
    assert pooled < 0.005
    small = tests["gate-small", "sim", "wil"]
    assert small == pytest.approx(0.0476, abs=1e-4)
    walk = tests["follow-walk", "sim", "wil"]
    assert walk == 1.0
    agreement = {one.mode: (one.cases_agree, one.cases) for one in rates.agreement}
    assert agreement == {"sim": (2, 5), "wil": (5, 5)}


def test_a_flight_that_proves_nothing_leaves_the_denominator() -> None:
    rates = pass_rates(
        [flight.result() for flight in flights("a", "wil", "PIPF", (0.0, 0.1, 0.2, 0.3))]
    )
    (rate,) = rates.rates
    assert (rate.passed, rate.flown, rate.unproven) == (2, 3, 1)


def test_equal_runs_have_neither_interval_nor_test() -> None:
    runs = [*flights("a", "sim", "PPPPP"), *flights("a", "wil", "FFFFF", SPREAD)]
    rates = pass_rates([run.result() for run in runs])
    equal, varied = rates.rates
    assert equal.deterministic
    assert equal.interval is None
    assert varied.interval is not None
    (test,) = rates.tests
    assert test.p is None
    assert test.why == "the flights of sim are equal"


def gap_campaign(wil_m: float = 0.1) -> list[Flight]:
    """Reality flies at 0 beside the way, wil at 0.1 m, sim at 0.4 m; each with a spread."""
    shifts = {"real": 0.0, "wil": wil_m, "sim": 0.4}
    return [
        flight
        for case in ("large", "small")
        for mode, shift in shifts.items()
        for flight in flights(
            case,
            mode,
            "PPPPP",
            [shift + SPREAD[place] for place in ORDERS[mode]],
            lag_m_s=0.3 if mode == "sim" else 0.1,
        )
    ]


def test_the_gap_is_that_of_the_paths(tmp_path: Path) -> None:
    gap = study_of(write_flown(tmp_path / "a", gap_campaign())).gap
    assert gap.left_out == ()
    for measure in ("dtw", "frechet", "rmse"):
        one = figure(gap, measure, "large")
        assert one.part == "behaviour"
        assert one.real_to_sim == pytest.approx(0.4, abs=1e-3)
        assert one.real_to_wil == pytest.approx(0.1, abs=1e-3)
        assert one.real_to_real == pytest.approx(0.02, abs=1e-3)
        assert one.closed_percent == pytest.approx(75.0, abs=0.5)
        assert one.holds is True
        assert one.closed_interval is not None
        assert one.closed_interval.low < 75.0 < one.closed_interval.high
    answers = figure(gap, "answers", ALL_CASES)
    assert answers.real_to_sim == pytest.approx(0.2)
    assert answers.real_to_wil == pytest.approx(0.0)
    assert answers.closed_percent == pytest.approx(100.0)
    assert answers.holds is None
    commands = figure(gap, "commands", ALL_CASES)
    assert (commands.real_to_sim, commands.closed_percent) == (0.0, None)


def test_a_gap_that_widens_is_negative(tmp_path: Path) -> None:
    gap = study_of(write_flown(tmp_path / "a", gap_campaign(wil_m=0.8))).gap
    one = figure(gap, "dtw", ALL_CASES)
    assert one.holds is False
    assert one.closed_percent == pytest.approx(-100.0, abs=1.0)


def test_a_gap_within_chance_is_undecided(tmp_path: Path) -> None:
    wide = (-0.6, -0.3, 0.0, 0.3, 0.6)
    given = [
        flight
        for mode, order in ORDERS.items()
        for flight in flights("a", mode, "PPPPP", [wide[place] for place in order])
    ]
    one = figure(study_of(write_flown(tmp_path / "a", given)).gap, "dtw", "a")
    assert one.nearer_interval is not None
    assert one.nearer_interval.low < 0.0 < one.nearer_interval.high
    assert one.holds is None


def test_equal_flights_have_a_gap_and_no_width(tmp_path: Path) -> None:
    given = [
        flight
        for mode, east_m in (("real", 0.0), ("wil", 0.1), ("sim", 0.4))
        for flight in flights("a", mode, "PPPP", [east_m] * 4)
    ]
    study = study_of(write_flown(tmp_path / "a", given))
    one = figure(study.gap, "dtw", "a")
    assert one.closed_percent == pytest.approx(75.0)
    assert (one.nearer_interval, one.closed_interval, one.holds) == (None, None, None)
    assert "deterministic" in one.basis
    assert "no spread" in {row[-1] for row in gap_rows(study).rows}


def test_a_run_that_cannot_be_compared_is_named_and_the_others_are(tmp_path: Path) -> None:
    folder = write_flown(tmp_path / "a", gap_campaign())
    (folder / "large/wil/2/judged.msgpack").write_bytes(b"\xc1 no judge log")
    (folder / "large/real/1/judged.msgpack").unlink()
    gap = study_of(folder).gap
    assert [text.partition(":")[0] for text in gap.left_out] == ["large/real/1", "large/wil/2"]
    assert figure(gap, "dtw", "large").basis.startswith("4 real, 5 sim, 4 wil")


def test_the_table_has_the_published_counts_beside_its_own(tmp_path: Path) -> None:
    passed = {"large": {"sim": "7/5", "wil": "1/5", "real": "too costly"}}
    document = {"published": {"source": "Table I", "passed": passed}}
    study = study_of(write_flown(tmp_path / "a", gap_campaign(), document=document))
    rows = result_rows(study)
    assert rows.head == (
        "case",
        *("simulation", "published"),
        *("WIL", "published"),
        *("reality", "published"),
    )
    assert rows.rows[0] == (
        "large",
        *("P 5 F 0 [0.48, 1.00]", "7/5"),
        *("P 5 F 0 [0.48, 1.00]", "P 1 F 4"),
        *("P 5 F 0 [0.48, 1.00]", "too costly"),
    )
    assert "published: Table I" in study_statements(study)


def test_the_command_prints_tables_and_one_document(tmp_path: Path, capsys: Capture) -> None:
    folder = write_flown(tmp_path / "a", gap_campaign())
    assert main(["gap", str(folder)]) == 0
    text = capsys.readouterr().out
    assert "gap closed" in text
    assert "75 % [" in text
    assert main(["gap", str(folder), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "wil/statistics/1"
    write_report(folder)
    assert json.loads((folder / "statistics.json").read_text()) == document
    page = (folder / "report.html").read_text()
    assert "Gap to reality" in page
    assert "75 % [" in page


@pytest.mark.parametrize("kind", ["missing", "file", "empty", "one mode", "damaged"])
def test_folders_without_a_gap(tmp_path: Path, capsys: Capture, kind: str) -> None:
    folder = tmp_path / "a"
    code = 2
    if kind == "file":
        folder.write_text("{}")
    elif kind == "empty":
        folder.mkdir()
    elif kind == "one mode":
        write_flown(folder, flights("a", "sim", "PP", (0.0, 0.1)))
    elif kind == "damaged":
        write_flown(folder, gap_campaign())
        (folder / "summary.json").write_text('{"campaign": ')
        code = 3
    assert main(["gap", str(folder)]) == code
    assert capsys.readouterr().err


def test_a_flight_prints_the_comparison_only_of_modes_beside_reality(tmp_path: Path) -> None:
    folder = write_flown(tmp_path / "a", gap_campaign())
    section = study_section(folder, read_campaign_documents(folder))
    assert section.text == study_text(study_of(folder))
    alone = write_flown(tmp_path / "b", flights("a", "sim", "PP", (0.0, 0.1)))
    of_one_mode = study_section(alone, read_campaign_documents(alone))
    assert of_one_mode.text == ""
    assert "Comparison of the modes" in section.html
    assert "Comparison of the modes" not in of_one_mode.html
    assert '<ul class="box">' in section.html
    assert '<ul class="box">' not in of_one_mode.html


def test_a_gap_that_cannot_be_measured_leaves_the_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_flown(tmp_path / "a", flights("a", "sim", "PP", (0.0, 0.1)))

    def fail(*_: object) -> None:
        raise ValueError("no axis")

    monkeypatch.setattr(Study, "read", fail)
    found = study_section(folder, read_campaign_documents(folder))
    (why,) = found.problems
    assert why == "the gap cannot be measured: ValueError: no axis"
    assert json.loads(found.files["statistics.json"])["left_out"] == [why]
    assert found.html == ""


def judged_with(path: Path, poses: list[tuple[float, float]]) -> None:
    """Record a goal from 1 s on, a vehicle, and an actor `drone`. poses: its time and north."""
    with JudgeLogWriter(path=path) as judged:
        judged.write(LoggedWorldEvent(1.0, "goal"))
        judged.write(StageSample(1.0, "goal"))
        for t_s, north_m in poses:
            judged.write(ActorPose(t_s, "drone", Pose.of(north_m, 0.0, 1.0), (0.0, 0.0, 0.0)))
        for t_s in (1.0, 6.0):
            judged.write(PoseSample(t_s, "real", Pose.of(0.0, 0.0, 1.0), (0.0, 0.0, 0.0)))
        judged.write(StageSample(5.0, "done"))


def moving_world() -> str:
    """A walker of 1 m/s, after 2 s of standing, over 1 m and back at 3 m/s; and a flown drone."""
    way = [
        {"north_m": 3.0, "east_m": 1.0, "speed_m_s": 1.0},
        {"north_m": 3.0, "east_m": 0.0, "speed_m_s": 3.0},
    ]
    still = [{"north_m": 0.0, "east_m": 0.0, "up_m": 1.0, "speed_m_s": 1.0}]
    objects = {
        "walker": {
            "shape": "person",
            "pose": {"north_m": 3.0},
            "motion": {"start": {"on": "goal", "delay_s": 2.0}, "waypoints": way},
        },
        "drone": {"shape": "quadrotor", "pose": {"up_m": 1.0}, "motion": {"waypoints": still}},
        "wall": {"shape": {"box": {"size_m": [1, 1, 1]}}, "pose": {"north_m": 9, "up_m": 1}},
    }
    origin = {"latitude_deg": 47.4, "longitude_deg": 8.5}
    return json.dumps({"schema": "wil/world/1", "origin": origin, "objects": objects})


def test_how_fast_moving_objects_were_by_hand(tmp_path: Path) -> None:
    """Walker: ten samples of 1 m/s, 3 1/3 of 3 m/s. Drone: 1, 0, 3 m/s, a second each; or 2 m/s."""
    folder = write_flown(tmp_path / "a", flights("walk", "wil", "PFI"), with_motion=False)
    hops = [(1.0, 0.0), (2.0, 1.0), (3.0, 1.0), (4.0, 4.0), (5.0, 4.0)]
    even = [(1.0, 0.0), (2.0, 2.0), (3.0, 4.0), (4.0, 4.0), (5.0, 4.0)]
    for rep, poses in (("1", hops), ("2", even), ("3", even)):
        place = folder / "walk/wil" / rep
        judged_with(place / "judged.msgpack", poses)
        facts = {"mode": "wil", "world": moving_world(), "world_file": "world.yaml"}
        settings = RecordingSettings()
        with McapRecorder(
            path=place / "run.mcap", epoch_s=0.0, clock="virtual", settings=settings, facts=facts
        ):
            pass
    study = study_of(folder)
    drone, walker = study.speeds
    assert (drone.object, drone.mode, drone.flights) == ("drone", "wil", 2)  # INVALID is left out
    assert drone.mean_m_s == pytest.approx((4 / 3 + 2.0) / 2)
    spread = ((1 - 4 / 3) ** 2 + (0 - 4 / 3) ** 2 + (3 - 4 / 3) ** 2) / 3
    assert drone.within_m_s == pytest.approx(spread**0.5 / 2)
    assert drone.between_m_s == pytest.approx((2.0 - 4 / 3) / 2**0.5)
    # The last tenth of a second has a third of one at 3 m/s: 0.1 m in 0.1 s.
    hand = [1.0] * 10 + [3.0] * 3 + [1.0]
    assert walker.mean_m_s == pytest.approx(statistics.mean(hand))
    assert walker.within_m_s == pytest.approx(statistics.pstdev(hand))
    assert walker.between_m_s == pytest.approx(0.0)
    assert speed_rows(study).rows[0] == (
        *("walk", "drone", "WIL", "2", "1.67 m/s"),
        *("0.62 m/s", "0.47 m/s"),
    )
    assert "how fast moving objects were" in study_text(study)
    page = write_report(folder, workers=1).path.read_text("utf-8")
    assert "How fast moving objects were" in page
    written = json.loads((folder / "statistics.json").read_text("utf-8"))
    assert [one["object"] for one in written["object_speeds"]] == ["drone", "walker"]
