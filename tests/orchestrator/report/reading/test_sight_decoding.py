"""Images of a recording on a page: the vehicle whose camera took them."""

from dataclasses import replace
from typing import Any

import pytest

from tests.orchestrator.mcap_runs import camera
from wil_campaign.orchestrator.recording.mcap.mcap_encode import McapEncoder
from wil_campaign.orchestrator.recording.mcap.mcap_settings import ImageSettings, RecordingSettings
from wil_campaign.orchestrator.report.reading.recorded_sights import RecordedSight, RecordedSights
from wil_campaign.orchestrator.report.reading.sight_decoding import ImageSize, decode_sights
from wil_campaign.vehicles.readings import Drawing, Source
from wil_campaign.worlds.frames import Pose


class Recorded:
    """A message as the reader of MCAP gives it."""

    def __init__(self, data: bytes, log_time: int) -> None:
        self.data = data
        self.log_time = log_time


@pytest.mark.parametrize(
    ("source", "vehicle"), [("real", "real"), ("twin", "twin"), ("mixed", "real")]
)
def test_the_vehicle_of_an_image_is_that_of_its_source(source: Source, vehicle: str) -> None:
    encoder = McapEncoder(epoch_s=0.0, settings=RecordingSettings())
    image = encoder.encode("camera", camera(1, source))[-1]
    message: Any = Recorded(image.data, image.log_ns)
    sights = {"camera": [RecordedSight(0.1, message, (), {})]}
    (seen,) = decode_sights(RecordedSights(sights), ImageSize(64, 64, 80), at_s=None)
    frame: Any = seen.perceived
    assert frame.view.vehicle == vehicle


def test_images_that_cannot_be_drawn_again_are_one_problem_of_the_report() -> None:
    settings = RecordingSettings(real=ImageSettings(keeps_drawn=False))
    encoder = McapEncoder(epoch_s=0.0, settings=settings)
    drawn = replace(camera(1, "real"), drawing=Drawing(Pose((0.0, 0.0, 0.0))))
    image = encoder.encode("camera", drawn)[-1]
    message: Any = Recorded(image.data, image.log_ns)
    found = RecordedSights({"camera": [RecordedSight(at_s, message, (), {}) for at_s in (1, 2)]})
    assert decode_sights(found, ImageSize(64, 64, 80), at_s=None) == []
    (problem,) = found.problems
    assert problem.endswith("cannot be drawn again: the recording has no world")
