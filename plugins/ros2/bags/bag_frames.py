"""The frames of a bag: those of the judged vehicle as in flight, others under its name."""

from collections.abc import Mapping

from wil_campaign.plugins.ros2.messages.reading_messages import optical_frame, ros_word_of_name
from wil_campaign.plugins.ros2.messages.ros_frames import (
    attitude_enu,
    enu_from_ned,
    optical_in_body,
    sensor_in_body,
)
from wil_campaign.plugins.ros2.messages.ros_messages import (
    BODY_FRAME,
    ODOMETRY_FRAME,
    WORLD_FRAME,
    FrameTransform,
)
from wil_campaign.worlds.camera import CameraMount
from wil_campaign.worlds.frames import AT_ORIGIN, Pose


class BagFrames:
    """The frames of the vehicles of a run. mounts: of cameras, as "real/camera"."""

    def __init__(self, subject: str, mounts: Mapping[str, CameraMount]) -> None:
        self._subject, self._mounts = subject, mounts
        self._known = {ODOMETRY_FRAME}
        self.fixed = [FrameTransform(WORLD_FRAME, ODOMETRY_FRAME, (0.0, 0.0, 0.0))]
        """The transforms that do not change, as far as they are known."""

    def within(self, vehicle: str) -> str:
        """Return what frames of a vehicle begin with: nothing for the one under test."""
        return "" if vehicle == self._subject else f"{ros_word_of_name(vehicle)}/"

    def moving(self, vehicle: str, pose: Pose) -> list[FrameTransform]:
        """Return the transforms that a vehicle's pose gives: its body's, its gimbals'."""
        parent = ODOMETRY_FRAME if vehicle == self._subject else WORLD_FRAME
        body = self.within(vehicle) + BODY_FRAME
        place, turned = enu_from_ned(pose.position_ned_m), attitude_enu(pose.q_wxyz)
        found = [FrameTransform(parent, body, place, turned)]
        for name, mount in self._mounts.items():
            whose, _, camera = name.partition("/")
            if whose == vehicle and mount.stabilized:
                found.append(self._camera(vehicle, camera, mount, pose))
        return found

    def add(self, vehicle: str, sensor: str, kind: str, mount: Pose) -> bool:
        """Add the frame of a sensor to the fixed ones; return whether it is new.

        mount: of what is no camera. A camera whose mount was not recorded has no frame.
        """
        within = self.within(vehicle)
        frame, is_camera = within + ros_word_of_name(sensor), kind in {"camera", "depth"}
        # Points that were made of a depth camera's images have a frame of their own.
        known = within + optical_frame(ros_word_of_name(sensor)) if is_camera else frame
        if known in self._known:
            return False
        self._known.add(known)
        if is_camera:
            camera = self._mounts.get(f"{vehicle}/{sensor}")
            if camera is None or camera.stabilized:
                return False
            self.fixed.append(self._camera(vehicle, sensor, camera, AT_ORIGIN))
        else:
            self.fixed.append(FrameTransform(within + BODY_FRAME, frame, *sensor_in_body(mount)))
        return True

    def _camera(self, vehicle: str, sensor: str, mount: CameraMount, pose: Pose) -> FrameTransform:
        within = self.within(vehicle)
        frame = within + optical_frame(ros_word_of_name(sensor))
        return FrameTransform(within + BODY_FRAME, frame, *optical_in_body(mount.in_body(pose)))
