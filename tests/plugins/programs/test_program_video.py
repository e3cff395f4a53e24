"""The video of a program: one camera's images, and too few of them are found out."""

from typing import cast

import numpy as np
import pytest

from tests.recipes.samples import beam
from wil_campaign.plugins.outlets.image_delivery import DeliveryCounts, ImageDelivery
from wil_campaign.plugins.programs.program_video import ProgramVideo
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.worlds.camera import Intrinsics

SMALL = Intrinsics.from_fov(16, 12, 1.2)
REFUSED = "rtp://127.0.0.1:5600: image not sent: its size 16x12 does not fit the stream of 8x6"


class Counted:
    """A delivery whose counts a test sets."""

    name = "rtp://127.0.0.1:5600"

    def __init__(self) -> None:
        self.got: list[CameraReading] = []
        self.counts = DeliveryCounts()
        self.trouble = ""

    def deliver(self, reading: CameraReading) -> None:
        self.got.append(reading)


def image(sensor: str) -> CameraReading:
    return CameraReading(
        1.0, 1.0, 0, "mixed", np.zeros((12, 16, 3), np.uint8), SMALL, sensor=sensor
    )


def video_of(delivery: Counted, period_s: float = 0.1) -> ProgramVideo:
    return ProgramVideo(
        sensor="camera", period_s=period_s, delivery=cast("ImageDelivery", delivery)
    )


def test_images_of_another_camera_are_not_sent() -> None:
    delivery = Counted()
    video = video_of(delivery)
    for reading in (image("camera"), image("down"), beam(1.0)):
        video.perceive(reading)
    assert [reading.sensor for reading in delivery.got] == ["camera"]


@pytest.mark.parametrize(
    ("dropped", "failed", "trouble", "said"),
    [
        (5, 0, "", ""),
        (2, 3, REFUSED, ""),
        (6, 0, "", "newer ones came before they were encoded; run less beside the flight"),
        (0, 6, REFUSED, REFUSED),
    ],
    ids=["slow for a moment", "some refused", "too slow", "refused"],
)
def test_fewer_than_half_of_two_seconds_images_are_too_few(
    dropped: int, failed: int, trouble: str, said: str
) -> None:
    delivery = Counted()
    video = video_of(delivery)
    delivery.counts = DeliveryCounts(100, 10, 80, 10)  # before the goal nothing is flown by it
    video.begin(10.0)
    sent = 10 - dropped - failed
    delivery.counts = DeliveryCounts(111, 10 + sent, 80 + dropped, 10 + failed)
    delivery.trouble = trouble
    assert video.fault(11.9) == ""
    fault = video.fault(12.0)
    assert video.fault_in_all() == fault
    if not said:
        assert fault == ""
    else:
        assert fault.startswith(
            f"only {sent} of 10 images of 'camera' were sent to its program: {said}"
        )


def test_a_program_that_goes_blind_late_is_found_out_as_soon() -> None:
    delivery = Counted()
    video = video_of(delivery)
    video.begin(0.0)
    delivery.counts = DeliveryCounts(900, 900)
    assert video.fault(60.0) == ""
    delivery.counts, delivery.trouble = DeliveryCounts(930, 900, 0, 30), REFUSED
    assert video.fault(62.0).startswith("only 0 of 30 images ")
    assert video.fault_in_all() == ""


def test_a_program_for_which_no_image_comes_is_blind_after_a_time() -> None:
    video = video_of(Counted())
    video.begin(0.0)
    assert (video.fault(1.9), video.fault_in_all()) == ("", "")
    assert video.fault(2.1) == "no image of 'camera' came for its program for 2 s"
    seldom = video_of(Counted(), period_s=3.0)
    seldom.begin(0.0)
    assert seldom.fault(5.9) == ""
    assert seldom.fault(6.1).endswith("for 6 s")
