"""Which reading a page shows as perceived, with which figures and inputs."""

from pathlib import Path

import numpy as np
import pytest

from tests.orchestrator.report.recorded_campaign import INTRINSICS
from wil_campaign.orchestrator.recording.mcap.mcap_settings import RecordingSettings
from wil_campaign.orchestrator.recording.mcap.mcap_writer import McapRecorder
from wil_campaign.orchestrator.recording.timestamps import VIRTUAL_EPOCH_S
from wil_campaign.orchestrator.report.reading.recorded_sights import RecordedSights, read_sights
from wil_campaign.recipes.pipeline.mixture import Provenance
from wil_campaign.vehicles.readings import CameraReading, Source


def image(k: int, source: Source) -> CameraReading:
    return CameraReading(
        t_s=k / 10,
        arrived_s=k / 10 + 0.05,
        seq=k,
        source=source,
        image_bgr=np.zeros((48, 64, 3), np.uint8),
        intrinsics=INTRINSICS,
        rendered=True,
    )


def provenance(k: int, *, is_mixed: bool) -> Provenance:
    return Provenance(
        real_seq=k,
        real_t_s=k / 10,
        twin_seq=k if is_mixed else None,
        twin_t_s=k / 10 if is_mixed else None,
        skew_ms=float(k) if is_mixed else None,
        latency_ms=50.0,
        dropped=None if is_mixed else "stale",
        given_real_seq=k,
        given_twin_seq=k if is_mixed else None,
    )


def recorded(folder: Path, *, mixed: set[int], wanted_s: float) -> RecordedSights:
    """Return the sights of a recording with images 0 to 39, ten in a second."""
    path = folder / "run.mcap"
    with McapRecorder(
        path=path, epoch_s=VIRTUAL_EPOCH_S, clock="virtual", settings=RecordingSettings()
    ) as recorder:
        for k in range(40):
            recorder.reading("camera", image(k, "real"))
            recorder.reading("camera", image(k, "twin"))
            reading = image(k, "mixed") if k in mixed else None
            figures = provenance(k, is_mixed=k in mixed)
            recorder.mixed("camera", reading, figures, now_s=k / 10 + 0.05)
    return read_sights(path, mode="wil", wanted_s=[wanted_s])


@pytest.mark.parametrize(
    ("mixed", "shown"),
    [
        # None is mixed between 1.0 s and 1.3 s: the image of 0.8 s is the newest at 0.9 s.
        (set(range(9)) | set(range(13, 40)), 8),
        # The inputs are long gone when the next mixture comes, or when none comes at all.
        (set(range(6)) | {39}, 5),
        (set(range(6)), 5),
    ],
)
def test_figures_and_inputs_are_those_of_the_image_that_is_shown(
    tmp_path: Path, mixed: set[int], shown: int
) -> None:
    (sight,) = recorded(tmp_path, mixed=mixed, wanted_s=0.9).sights["camera"]
    assert sight.perceived.sequence == shown
    assert sight.provenance["skew_ms"] == shown
    assert [one.sequence for one in sight.beside] == [shown, shown]


def test_the_plots_have_a_row_for_each_call_of_the_mixer(tmp_path: Path) -> None:
    found = recorded(tmp_path, mixed={0, 1, 3}, wanted_s=0.9)
    rows = found.provenances["camera"]
    assert len(rows) == 40
    assert [row["skew_ms"] for _, row in rows[:4]] == [0.0, 1.0, None, 3.0]
