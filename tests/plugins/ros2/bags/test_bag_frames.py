"""The frames of a bag's sensors."""

from wil_campaign.plugins.ros2.bags.bag_frames import BagFrames
from wil_campaign.worlds.camera import CameraMount
from wil_campaign.worlds.frames import AT_ORIGIN, Pose


def test_points_made_of_a_depth_camera_have_a_frame_beside_its_images() -> None:
    mount = Pose((0.1, 0.2, 0.3))
    frames = BagFrames("real", {"real/stereo": CameraMount(mount)})
    assert frames.add("real", "stereo", "depth", AT_ORIGIN)
    assert frames.add("real", "stereo", "lidar_points", mount)
    assert not frames.add("real", "stereo", "depth", AT_ORIGIN)
    found = {one.child: one.position_m for one in frames.fixed}
    assert found["stereo_optical"] == found["stereo"] == (0.1, -0.2, -0.3)
