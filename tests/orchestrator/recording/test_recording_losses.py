"""What run.mcap lacks is counted by topic, and beyond a limit the run proves nothing."""

import threading
from io import FileIO
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.mcap_runs import read
from tests.orchestrator.operator.test_campaign_controller import RESULT
from tests.recipes.samples import beam
from wil_campaign.foundation.background_file import DiskPatience
from wil_campaign.orchestrator.recording.mcap import mcap_file, mcap_writer
from wil_campaign.orchestrator.recording.mcap.mcap_encode import McapEncoder
from wil_campaign.orchestrator.recording.mcap.mcap_settings import LOSSLESS
from wil_campaign.orchestrator.recording.mcap.mcap_writer import McapRecorder, TopicLoss
from wil_campaign.orchestrator.recording.run_recorder import RunRecorder, excessive_loss
from wil_campaign.orchestrator.run_results.caveats import loss_texts
from wil_campaign.orchestrator.run_results.run_result import TopicMessageLoss, later_events_of
from wil_campaign.plugins.python.mcap_reader import RecordedReading
from wil_campaign.safety.model.verdict import DecisiveEvent, RunDecision


@pytest.mark.parametrize(
    ("losses", "max_loss", "said"),
    [
        ([], 0.01, ""),
        ([TopicLoss("/real/camera", 1000, 10)], 0.01, ""),
        ([TopicLoss("/real/camera", 1000, 11)], 0.01, "run.mcap lacks 11 of 1000 of /real/camera"),
        ([TopicLoss("/real/camera", 1000, 11)], 0.02, ""),
        ([TopicLoss("/real/camera", 1000, 1)], 0.0, "run.mcap lacks 1 of 1000 of /real/camera"),
        (
            [TopicLoss("/mixed/camera/visibility", 1000, 1), TopicLoss("/real/imu", 9, 9)],
            0.01,
            "run.mcap lacks 1 of 1000 of /mixed/camera/visibility, 9 of 9 of /real/imu: ",
        ),
    ],
)
def test_losses_above_the_limit_are_excessive(
    losses: list[TopicLoss], max_loss: float, said: str
) -> None:
    found = excessive_loss(losses, max_loss=max_loss)
    assert found.startswith(said)
    assert bool(found) == bool(said)


def test_readings_that_cannot_be_encoded_are_counted_by_topic(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    encode = McapEncoder.encode

    def broken(self: McapEncoder, sensor: str, reading: Any) -> Any:
        if sensor == "range":
            raise ValueError("it has no place")
        return encode(self, sensor, reading)

    monkeypatch.setattr(McapEncoder, "encode", broken)
    with McapRecorder(path=tmp_path / "run.mcap", epoch_s=0.0, clock="virtual") as run:
        for _ in range(7):
            run.reading("range", beam(1.0))
            run.reading("height", beam(1.0))
        report = run.close()
    assert report.losses == (TopicLoss("/twin/range", 7, 7),)
    assert report.failed == 7
    assert "lacks 7 of 7 of /twin/range" in excessive_loss(report.losses, max_loss=0.01)


@pytest.mark.parametrize(
    ("stalls_at_end", "waiting"), [(False, ", 3 messages wait for it"), (True, "")]
)
def test_a_recording_is_incomplete_until_its_dead_disk_comes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stalls_at_end: bool, waiting: str
) -> None:
    """No message counts as lost: all of them still wait, or only the end of the file does."""
    reached, released = threading.Event(), threading.Event()
    finish = mcap_file.ChunkedFile.finish

    def stall() -> None:
        reached.set()
        assert released.wait(60.0)

    class Stalled(FileIO):
        def write(self, data: Any) -> int:
            if not stalls_at_end:
                stall()
            return super().write(data)

    def last(self: mcap_file.ChunkedFile, metadata: dict[str, str]) -> None:
        if stalls_at_end:
            stall()
        finish(self, metadata)

    class Brief(DiskPatience):
        def waits_on(self, polls: int, *, is_brief: bool = False) -> bool:
            return not reached.is_set()

    monkeypatch.setattr(mcap_file, "FileIO", Stalled)
    monkeypatch.setattr(mcap_file.ChunkedFile, "finish", last)
    monkeypatch.setattr(mcap_writer, "patience", Brief())
    said: list[str] = []
    faults: list[BaseException] = []
    others = set(threading.enumerate())
    with RunRecorder(
        folder=tmp_path,
        time=lambda: 1.0,
        epoch_s=0.0,
        vehicles=(),
        collision_oracles=frozenset(),
        clock="virtual",
        settings=LOSSLESS,
        broken=said.append,
        facts={},
        fault=lambda error, _: faults.append(error),
        incomplete=said.append,
        max_loss=1.0,
    ) as run:
        run.reading(beam(1.0))
        run.stage("goal", 1.0)
    why = f"run.mcap is cut off (the disk takes nothing{waiting}); check the disk of {tmp_path}"
    assert (said, faults, run.losses) == ([why], [], ())
    assert "the disk takes nothing" in (tmp_path / "log.jsonl").read_text()
    released.set()
    for thread in set(threading.enumerate()) - others:
        thread.join()
    found, recording = read(tmp_path / "run.mcap")
    assert [type(one) for one in found].count(RecordedReading) == 1
    assert recording.end is not None
    assert recording.end.whole, "a disk that comes back gets all"


def test_losses_stand_under_the_table() -> None:
    from dataclasses import replace

    run = replace(RESULT, losses=(TopicMessageLoss("/real/camera", 282, 3),))
    (text,) = loss_texts([run])
    assert text.startswith("3 of 282 of /real/camera (")


def test_equal_events_are_counted_and_many_are_cut() -> None:
    first = DecisiveEvent(1.0, "FAIL", "touched", "", "", "")
    equal = [DecisiveEvent(2.0 + at, "ERROR", "no place", "", "", "") for at in range(612)]
    (also,) = later_events_of(RunDecision("FAIL", "touched", (*equal,), first.source, "", ""))
    assert (also.reason, also.at_s) == ("no place (612 times)", 2.0)
    many = tuple(DecisiveEvent(2.0, "ERROR", f"no {number}", "", "", "") for number in range(80))
    cut = later_events_of(RunDecision("FAIL", "touched", many, "", "", ""))
    assert len(cut) == 50
    assert cut[-1].reason == "31 more events; log.jsonl has all of them"
    passes = tuple(DecisiveEvent(2.0, "FAIL", f"no {number}", "", "", "") for number in range(80))
    cut = later_events_of(RunDecision("FAIL", "touched", (*passes, many[0]), "", "", ""))
    assert cut[-1].verdict == "ERROR"
