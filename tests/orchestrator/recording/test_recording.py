"""What is recorded can be read by others, also when it was cut."""

import csv
import errno
import json
import math
import time
from pathlib import Path

import av
import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.background_file import BackgroundFile
from wil_campaign.orchestrator.recording.trajectory import TrajectoryRow, TrajectoryWriter
from wil_campaign.orchestrator.recording.video import VideoWriter
from wil_campaign.orchestrator.state.run_log import RunLog
from wil_campaign.vehicles.mavlink.tlog import TlogWriter
from wil_campaign.vehicles.setpoints import VelocitySetpoint
from wil_campaign.worlds.frames import Pose


def picture(level: int) -> "np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]":
    return np.full((48, 64, 3), level, np.uint8)


def test_pymavlink_reads_our_tlog(tmp_path: Path) -> None:
    mav = mavlink.MAVLink(None, 1, 1)
    frames = [mavlink.MAVLink_heartbeat_message(2, 12, 29, 0, 3, 3).pack(mav) for _ in range(3)]
    with TlogWriter(path=tmp_path / "real.tlog", epoch_s=1_767_225_600.0) as log:
        for k, frame in enumerate(frames):
            log.write(0.5 * k, frame)
    reader = mavutil.mavlink_connection(str(tmp_path / "real.tlog"))
    stamps = []
    while (message := reader.recv_match()) is not None:
        assert message.get_type() == "HEARTBEAT"
        stamps.append(message._timestamp)
    reader.close()
    assert stamps == [1_767_225_600.0, 1_767_225_600.5, 1_767_225_601.0]


def pictures(data: bytes, path: Path) -> int:
    """Return how many pictures of a video that was cut off can be seen."""
    if not data:
        return 0
    path.write_bytes(data)
    with av.open(str(path)) as container:
        return len(list(container.decode(video=0)))


def test_a_video_plays_and_keeps_its_times(tmp_path: Path) -> None:
    path = tmp_path / "mixed.mp4"
    with VideoWriter(path=path, rate_hz=10) as video:
        for k in range(20):
            video.write(5.0 + k / 10, picture(10 * k))
    with av.open(str(path)) as container:
        times = [float(frame.time or 0.0) for frame in container.decode(video=0)]
    assert len(times) == 20
    assert np.diff(times) == pytest.approx(0.1, abs=1e-3)


@pytest.mark.parametrize(
    "times_s", [[k / 60 for k in range(9)], [0.0, 0.2, 0.21, 1.0], [0.017 * k for k in range(9)]]
)
def test_a_video_keeps_times_that_are_nearer_than_its_rate(
    tmp_path: Path, times_s: list[float]
) -> None:
    """Two within a tick of 1/30 s were an internal error of `mix` and of `report --video`."""
    path = tmp_path / "mixed.mp4"
    with VideoWriter(path=path, rate_hz=30) as video:
        for k, t_s in enumerate(times_s):
            video.write(t_s, picture(10 * k))
    with av.open(str(path)) as container:
        found = [float(frame.time or 0.0) for frame in container.decode(video=0)]
    assert found == pytest.approx(times_s, abs=1e-4)


def test_a_video_whose_writer_was_killed_plays_up_to_the_last_second(tmp_path: Path) -> None:
    path = tmp_path / "mixed.mp4"
    with VideoWriter(path=path, rate_hz=10) as video:
        for k in range(35):
            video.write(k / 10, picture(5 * k))
        # A thread writes it: it gets there, or this test does not end.
        while pictures(path.read_bytes(), tmp_path / "cut.mp4") < 20:
            time.sleep(0.01)


def test_a_video_that_a_full_disk_refuses_raises_nothing_but_that(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The library that encodes it raises errors of its own once its file raised one."""

    def refuse(self: BackgroundFile, _: bytes) -> bool:
        self._error = OSError(errno.ENOSPC, "No space left on device")
        return False

    monkeypatch.setattr(BackgroundFile, "_put", refuse)
    noise, refused = np.random.default_rng(1), []
    video = VideoWriter(path=tmp_path / "mixed.mp4", rate_hz=10).__enter__()
    for k in range(30):
        try:
            video.write(k / 10, noise.integers(0, 256, (480, 640, 3), np.uint8))
        except OSError as error:
            refused.append(error)
    with pytest.raises(OSError, match="No space left"):
        video.__exit__()
    assert len(refused) >= 20
    assert {error.errno for error in refused} == {errno.ENOSPC}


def test_no_picture_leaves_no_file(tmp_path: Path) -> None:
    with VideoWriter(path=tmp_path / "mixed.mp4", rate_hz=10):
        pass
    assert list(tmp_path.iterdir()) == []


def test_trajectory_rows_have_all_columns_and_empty_cells_for_the_unknown(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.csv"
    pose = Pose.of(1.0, 2.0, 3.0, yaw_rad=0.5)
    with TrajectoryWriter(path=path) as trajectory:
        trajectory.write(
            TrajectoryRow(
                t_s=1.25,
                vehicle="real",
                stage="goal",
                mode="OFFBOARD",
                armed=True,
                estimate=pose,
                velocity_ned_m_s=(0.1, 0.2, 0.3),
                truth=None,
                setpoint=VelocitySetpoint((1.0, 0.0, 0.0), yaw_rad=0.5),
                note="approach",
            )
        )
    (row,) = csv.DictReader(path.read_text(encoding="utf-8").splitlines())
    assert None not in row.values()
    assert float(row["est_down_m"]) == -3.0
    assert math.isclose(float(row["est_yaw_rad"]), 0.5, abs_tol=1e-6)
    assert row["true_north_m"] == ""
    assert (row["sp_kind"], row["sp_north"], row["note"]) == ("velocity", "1.000000", "approach")


def test_the_log_is_on_its_way_at_once(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    with RunLog(path=path) as log:
        log.write(0.5, "stage", name="takeoff")
        assert json.loads(path.read_text(encoding="utf-8")) == {
            "t_s": 0.5,
            "event": "stage",
            "name": "takeoff",
        }


def test_the_log_takes_half_a_surrogate_pair_and_ignores_late_lines(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    with RunLog(path=path) as log:
        log.write(0.5, "vehicle", text="half a pair: \ud800")
    log.write(0.6, "late")
    (line,) = path.read_text(encoding="utf-8").splitlines()
    assert json.loads(line)["text"] == "half a pair: \ud800"


def test_a_note_with_separators_stays_one_cell(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.csv"
    row = TrajectoryRow(
        t_s=0.0,
        vehicle="real",
        stage="goal",
        mode="OFFBOARD",
        armed=True,
        estimate=None,
        velocity_ned_m_s=None,
        truth=None,
        setpoint=None,
        note='left, "then" right',
    )
    with TrajectoryWriter(path=path) as trajectory:
        trajectory.write(row)
    (read,) = csv.DictReader(path.read_text(encoding="utf-8").splitlines())
    assert None not in read
    assert read["note"] == 'left, "then" right'
