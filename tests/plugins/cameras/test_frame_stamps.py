"""Numbers, times and sizes of pictures."""

import numpy as np
import pytest

from wil_campaign.plugins.cameras.frame_stamps import FrameStamper
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.vehicles.sources.camera_source import ImageChangedError
from wil_campaign.worlds.camera import Intrinsics

SMALL = Intrinsics.from_fov(8, 6, 1.0)
PICTURE = np.zeros((6, 8, 3), np.uint8)


def stamper(rate_hz: float | None = None) -> FrameStamper:
    return FrameStamper(name="camera", side="real", intrinsics=SMALL, rate_hz=rate_hz)


def seqs(stamper: FrameStamper, stamps_s: list[float]) -> list[int]:
    readings = [stamper.reading(PICTURE, stamp_s=s, arrived_s=s + 0.01) for s in stamps_s]
    return [reading.seq for reading in readings if reading is not None]


def test_a_reading_says_what_it_is() -> None:
    reading = stamper().reading(PICTURE, stamp_s=7.0, arrived_s=1.0)
    assert isinstance(reading, CameraReading)
    assert (reading.t_s, reading.arrived_s, reading.seq) == (1.0, 1.0, 0)
    assert reading.source == "real"
    assert reading.rendered is False
    assert reading.intrinsics == SMALL


def test_gaps_in_the_stamps_of_a_steady_camera_are_missed_exposures() -> None:
    camera = stamper(rate_hz=10.0)
    assert seqs(camera, [0.0, 0.1, 0.4, 0.52]) == [0, 1, 4, 5]
    assert camera.missed == 2


def test_an_unsteady_camera_counts_images_that_arrived() -> None:
    camera = stamper()
    assert seqs(camera, [0.0, 0.1, 0.4]) == [0, 1, 2]
    assert camera.missed == 0


def test_a_skipped_exposure_is_not_counted_as_missed() -> None:
    camera = stamper(rate_hz=10.0)
    seqs(camera, [0.0])
    camera.skip_exposure()
    camera.skip_exposure()
    assert seqs(camera, [0.3]) == [3]
    assert camera.missed == 0


def test_an_image_that_is_not_newer_is_kept_back() -> None:
    camera = stamper()
    assert camera.reading_at(PICTURE, t_s=1.0, arrived_s=1.0) is not None
    assert camera.reading_at(PICTURE, t_s=1.0, arrived_s=1.1) is None
    after = camera.reading_at(PICTURE, t_s=1.2, arrived_s=1.2)
    assert after is not None
    assert after.seq == 2


@pytest.mark.parametrize("stamp_s", [None, float("nan")])
def test_an_image_that_lost_its_stamp_is_kept_back(stamp_s: float | None) -> None:
    camera = stamper(rate_hz=10.0)
    assert seqs(camera, [5.0, 5.1]) == [0, 1]
    assert camera.reading(PICTURE, stamp_s=stamp_s, arrived_s=5.9) is None
    after = camera.reading(PICTURE, stamp_s=5.3, arrived_s=5.91)
    assert after is not None
    assert after.t_s == pytest.approx(5.31)
    assert (after.seq, camera.missed) == (3, 0)


def test_images_of_a_sender_without_stamps_are_of_when_they_came() -> None:
    camera = stamper()
    readings = [camera.reading(PICTURE, stamp_s=None, arrived_s=s) for s in (1.0, 1.2)]
    assert [reading and reading.t_s for reading in readings] == [1.0, 1.2]


def test_a_new_start_of_the_sender_is_no_gap() -> None:
    camera = stamper(rate_hz=10.0)
    first = camera.reading(PICTURE, stamp_s=50.0, arrived_s=1.0)
    again = camera.reading(PICTURE, stamp_s=0.0, arrived_s=31.0)
    assert first is not None
    assert again is not None
    assert (first.seq, again.seq, camera.missed) == (0, 1, 0)


def test_another_size_is_an_error_that_says_both() -> None:
    with pytest.raises(ImageChangedError, match=r"images are 4x3.*8x6.*calibrate"):
        stamper().reading(np.zeros((3, 4, 3), np.uint8), stamp_s=0.0, arrived_s=0.0)


def test_an_image_a_second_later_than_the_quickest_is_kept_back() -> None:
    """As by a clock of another unit: its stamps fall behind, and so would its times."""
    camera = stamper()
    ages = [
        None if one is None else one.arrived_s - one.t_s
        for k in range(300)
        for one in [camera.reading(PICTURE, stamp_s=0.01 * k, arrived_s=0.1 * k)]
    ]
    assert None in ages
    assert max(age for age in ages if age is not None) <= 1.0


def test_images_of_a_sender_that_begins_anew_all_the_time_are_kept_back() -> None:
    """Two cameras that send to one port; each of them begins anew after the other."""
    camera = stamper()
    for k in range(100):
        camera.reading(PICTURE, stamp_s=5.0 + 0.1 * k, arrived_s=0.1 * k)
        camera.reading(PICTURE, stamp_s=900.0 + 0.1 * k, arrived_s=0.1 * k + 0.05)
    assert camera.reading(PICTURE, stamp_s=15.0, arrived_s=10.0) is None
    alone = [camera.reading(PICTURE, stamp_s=15.1 + k, arrived_s=10.1 + k) for k in range(10)]
    assert alone[0] is None
    assert alone[-1] is not None
