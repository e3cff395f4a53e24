"""Images of a recording on a page: the vehicle whose camera took them."""

from typing import Any

import pytest

from tests.orchestrator.mcap_runs import camera
from wil_campaign.orchestrator.recording.mcap.mcap_encode import Encoder
from wil_campaign.orchestrator.recording.mcap.mcap_settings import RecordingSettings
from wil_campaign.orchestrator.report.reading.sight_decoding import _decode
from wil_campaign.vehicles.readings import Source


class Recorded:
    """A message as the reader of MCAP gives it."""

    def __init__(self, data: bytes, log_time: int) -> None:
        self.data = data
        self.log_time = log_time


@pytest.mark.parametrize(
    ("source", "vehicle"), [("real", "real"), ("twin", "twin"), ("mixed", "real")]
)
def test_the_vehicle_of_an_image_is_that_of_its_source(source: Source, vehicle: str) -> None:
    encoder = Encoder(epoch_s=0.0, settings=RecordingSettings())
    image = encoder.encode("camera", camera(1, source))[-1]
    message: Any = Recorded(image.data, image.log_ns)
    frame: Any = _decode(message, 64, 80, 0)
    assert frame.view.vehicle == vehicle
