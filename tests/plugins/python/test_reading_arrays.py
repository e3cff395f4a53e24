"""Readings as arrays: shapes, poses, what differs from reading to reading, what some lack."""

from dataclasses import replace

import numpy as np

from tests.recipes.samples import beam, camera, cloud
from wil_campaign.plugins.python.mcap_reader import arrays_of_readings
from wil_campaign.vehicles.readings import PoseReading
from wil_campaign.worlds.frames import Pose


def test_numbers_images_and_poses_are_stacked() -> None:
    pose = Pose((1.0, 2.0, -3.0))
    readings = [PoseReading(t_s, t_s, "real", pose, seq=7) for t_s in (0.5, 1.0)]
    found = arrays_of_readings(readings)
    assert found["t_s"].tolist() == [0.5, 1.0]
    assert found["pose_position_m"].tolist() == [[1.0, 2.0, -3.0]] * 2
    assert found["pose_q_wxyz"].shape == (2, 4)
    assert not {"source", "sensor", "velocity_ned_m_s"} & set(found)
    image = camera()
    assert arrays_of_readings([image] * 3)["image_bgr"].shape == (3, *image.image_bgr.shape)
    assert arrays_of_readings([beam(2.0)])["range_m"].shape == (1,)


def test_what_differs_in_shape_or_is_lacking_stays_in_its_row() -> None:
    first = cloud([[1, 2, 3], [4, 5, 6]])
    points = first.points_frd_m
    second = replace(first, points_frd_m=points[:1], object_ids=None, t_s=9.0)
    found = arrays_of_readings([first, second])
    assert [len(one) for one in found["points_frd_m"]] == [len(points), 1]
    assert found["t_s"][1] == 9.0
    third = replace(first, object_ids=np.zeros(len(points), np.uint8))
    ids = arrays_of_readings([second, third])["object_ids"]
    assert ids[0] is None
    assert ids[1].shape == (len(points),)
    assert arrays_of_readings([]) == {}
