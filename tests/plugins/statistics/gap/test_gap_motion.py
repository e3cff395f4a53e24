"""The motion of a run for the gap: what a damaged trajectory.csv is taken for."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tests.orchestrator.reading.flown_campaign import DONE_S, flights, write_flown
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.run_results.evidence_files import evidence_digests
from wil_campaign.orchestrator.run_results.result_reader import read_result
from wil_campaign.plugins.statistics.gap.motion import MotionError, read_motion
from wil_campaign.plugins.statistics.study import Study
from wil_campaign.plugins.statistics.study_tables import study_statements

RUN = "large/real/1"


@pytest.fixture
def flown(tmp_path: Path) -> Path:
    given = [
        flight for mode in ("real", "wil") for flight in flights("large", mode, "PP", (0.0, 0.1))
    ]
    return write_flown(tmp_path / "gate", given)


def lines_of(flown: Path) -> list[bytes]:
    return (flown / RUN / "trajectory.csv").read_bytes().splitlines(keepends=True)


@pytest.mark.parametrize(
    ("kept", "says"),
    [
        (lambda lines: [*lines[:40], lines[40][:9]], "cut off in the middle of a row"),
        (lambda lines: lines[:41], "trajectory.csv ends at 3.90 s, before the goal's end"),
        (lambda lines: [*lines[:40], b"\xff,?\n", *lines[41:]], "1 rows cannot be read"),
    ],
)
def test_a_damaged_trajectory_stands_for_no_commands(
    flown: Path, kept: Callable[[list[bytes]], list[bytes]], says: str
) -> None:
    (flown / RUN / "trajectory.csv").write_bytes(b"".join(kept(lines_of(flown))))
    with pytest.raises(MotionError, match=says):
        read_motion(flown / RUN, "real", 1)
    study = Study.read(flown)
    assert study.gap.left_out[0].startswith(f"{RUN}: trajectory.csv")
    assert any(RUN in text and says in text for text in study_statements(study))


def test_a_flight_with_files_of_another_one_is_left_out(flown: Path) -> None:
    place = flown / RUN
    result = replace(read_result(place / "result.json"), evidence_files=evidence_digests(place))
    (place / "result.json").write_text(to_json(result))
    assert Study.read(flown).gap.left_out == ()
    shutil.copy(flown / "large/real/2/judged.msgpack", place)
    (left_out,) = Study.read(flown).gap.left_out
    assert left_out.startswith(f"{RUN}: judged.msgpack is not that of this flight")


def test_a_trajectory_that_ends_after_the_goal_is_whole(flown: Path) -> None:
    lines = lines_of(flown)[: round(DONE_S * 10) + 2]
    (flown / RUN / "trajectory.csv").write_bytes(b"".join(lines))
    assert read_motion(flown / RUN, "real", 1).kind == "velocity"


def test_without_a_trajectory_the_path_alone_is_compared(flown: Path) -> None:
    (flown / RUN / "trajectory.csv").unlink()
    motion = read_motion(flown / RUN, "real", 1)
    assert motion.kind == ""
    assert len(motion.positions_ned_m) == 41
