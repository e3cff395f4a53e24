"""Transforms of frames of reference: axes, attitudes, offsets of pose and heading, mounts."""

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import model_validator

from wil_campaign.foundation.files.documents import Part
from wil_campaign.recipes.model.registry import SidedParameters, StepContext, step
from wil_campaign.recipes.operations.step_parameters import Degrees, Metres, RotationPart
from wil_campaign.recipes.steps.transform.geometry import refuse_own_side
from wil_campaign.recipes.working import AnyMasked, CannotMixError, Masked, Operator
from wil_campaign.vehicles.readings import (
    GpsReading,
    ImuReading,
    LidarPointsReading,
    LidarScanReading,
    PoseReading,
    Reading,
)
from wil_campaign.worlds.frames import (
    Pose,
    Quat,
    add,
    frd_from_flu,
    matrix_from_quat,
    ned_from_enu,
    quat_conjugate,
    quat_from_euler,
    quat_multiply,
    quat_normalize,
    rotate,
)
from wil_campaign.worlds.geodesy import LocalFrame

_NED_FROM_ENU: Quat = (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0)
_FRD_FROM_FLU: Quat = (0.0, 1.0, 0.0, 0.0)


class AxesParameters(SidedParameters):
    """world, body: the axes of a source's frames; they become NED and FRD."""

    reshapes = True

    world: Literal["ned", "enu"] = "ned"
    body: Literal["frd", "flu"] = "frd"


@step(
    "axes",
    stage="transform",
    sensors=("pose", "gps", "imu", "lidar", "lidar_points"),
    parameters=AxesParameters,
)
def axes(parameters: AxesParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Convert a source's axes: the world's ENU into NED, the body's FLU into FRD.

    Positions and velocities by the world's axes; specific force, rates, points and the direction of
    a scan's angles by the body's; an attitude (body to world) by both.
    """
    enu, flu = parameters.world == "enu", parameters.body == "flu"

    def operator(work: AnyMasked, other: AnyMasked | None) -> AnyMasked:  # noqa: ARG001 - the interface
        return Masked(_turn_axes(work.reading, enu=enu, flu=flu), work.mask)

    return operator


def _turn_axes(reading: Reading, *, enu: bool, flu: bool) -> Reading:
    """Return a reading with its frames turned from ENU to NED, from FLU to FRD."""
    match reading:
        case PoseReading():
            return _turn_pose(reading, enu=enu, flu=flu)
        case GpsReading() if enu:
            return replace(reading, velocity_ned_m_s=ned_from_enu(reading.velocity_ned_m_s))
        case ImuReading() if flu:
            return replace(
                reading,
                specific_force_frd_m_s2=frd_from_flu(reading.specific_force_frd_m_s2),
                rates_frd_rad_s=frd_from_flu(reading.rates_frd_rad_s),
            )
        case LidarPointsReading() if flu:
            return replace(reading, points_frd_m=reading.points_frd_m * _FLIP)
        case LidarScanReading() if flu:
            return replace(
                reading,
                start_angle_rad=-reading.start_angle_rad,
                step_rad=-reading.step_rad,
            )
        case _:
            return reading


_FLIP = np.array([1.0, -1.0, -1.0], np.float32)


def _turn_pose(reading: PoseReading, *, enu: bool, flu: bool) -> PoseReading:
    """Return a pose reading turned from ENU to NED, from FLU to FRD frames."""
    position, q = reading.pose.position_ned_m, reading.pose.q_wxyz
    velocity = reading.velocity_ned_m_s
    if enu:
        position, q = ned_from_enu(position), quat_multiply(_NED_FROM_ENU, q)
        velocity = None if velocity is None else ned_from_enu(velocity)
    if flu:
        q = quat_multiply(q, _FRD_FROM_FLU)
    return replace(reading, pose=Pose(position, _positive(q)), velocity_ned_m_s=velocity)


def _positive(q: Quat) -> Quat:
    """Return the same rotation between frames with w >= 0."""
    return q if q[0] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])


class AttitudeParameters(SidedParameters):
    """The convention of a source's attitude. order: of its numbers. of: direction."""

    tolerates = frozenset({"out_of_range"})

    order: Literal["wxyz", "xyzw", "euler_rad", "euler_deg"] = "wxyz"
    of: Literal["body_to_world", "world_to_body"] = "body_to_world"


@step("attitude", stage="transform", sensors=("pose",), parameters=AttitudeParameters)
def attitude(parameters: AttitudeParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Convert a pose's attitude from its source's convention: order, Euler angles, direction.

    The source's four numbers are in q_wxyz: (w, x, y, z), (x, y, z, w), or (roll, pitch, yaw,
    anything) in radians or degrees; they become the quaternion (w, x, y, z) from body to world.
    """
    unit = math.pi / 180.0 if parameters.order == "euler_deg" else 1.0

    def operator(work: Masked[PoseReading], other: AnyMasked | None) -> Masked[PoseReading]:  # noqa: ARG001 - the interface
        a, b, c, d = work.reading.pose.q_wxyz
        if parameters.order == "wxyz":
            q = (a, b, c, d)
        elif parameters.order == "xyzw":
            q = (d, a, b, c)
        else:
            q = quat_from_euler(a * unit, b * unit, c * unit)
        try:
            q = quat_normalize(q)
        except ValueError as error:
            raise CannotMixError("mismatch", f"attitude: {error}") from None
        if parameters.of == "world_to_body":
            q = quat_conjugate(q)
        pose = Pose(work.reading.pose.position_ned_m, _positive(q))
        return Masked(replace(work.reading, pose=pose), work.mask)

    return operator


class OffsetParameters(SidedParameters):
    """north_m, east_m, up_m: the shift of the world frame. rotation: turn of the heading.

    about: `body` turns the vehicle at its place; `origin` turns the whole frame about its origin,
    and then shifts it. yaw_deg: turn of the heading, clockwise seen from above; or give `rotation`.
    """

    north_m: Metres = 0.0
    east_m: Metres = 0.0
    up_m: Metres = 0.0
    yaw_deg: Degrees = 0.0
    rotation: RotationPart | None = None
    about: Literal["body", "origin"] = "body"

    @model_validator(mode="after")
    def _one_turn(self) -> "OffsetParameters":
        """Refuse an offset that gives both yaw_deg and rotation."""
        if self.yaw_deg and self.rotation is not None:
            raise ValueError("give yaw_deg or rotation, not both")
        return self

    def pose(self) -> Pose:
        """Return the offset as a pose in the world frame."""
        turn = (
            self.rotation.quaternion()
            if self.rotation is not None
            else quat_from_euler(0.0, 0.0, math.radians(self.yaw_deg))
        )
        return Pose((self.north_m, self.east_m, -self.up_m), turn)

    def refuses(self, kind: str) -> str:
        """Return why a GPS fix cannot be turned about the world frame's origin."""
        if kind == "gps" and self.about == "origin":
            return "a GPS position has no origin to rotate about; use local first"
        return ""


@step("offset", stage="transform", sensors=("pose", "gps"), parameters=OffsetParameters)
def offset(parameters: OffsetParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Move a position by metres north, east and up, and turn the heading.

    A pose (NED metres) turns with its velocity; a fix moves on WGS-84 and turns its velocity.
    """
    moved, about_origin = parameters.pose(), parameters.about == "origin"

    def operator(work: AnyMasked, other: AnyMasked | None) -> AnyMasked:  # noqa: ARG001 - the interface
        return Masked(_offset(work.reading, moved, about_origin=about_origin), work.mask)

    return operator


def _offset(reading: PoseReading | GpsReading, moved: Pose, *, about_origin: bool) -> Reading:
    """Return a pose or fix moved and turned by an offset in the world frame."""
    turn = moved.q_wxyz
    if isinstance(reading, GpsReading):
        here = LocalFrame(reading.latitude_deg, reading.longitude_deg, reading.altitude_m)
        place = here.to_geodetic(moved.position_ned_m)
        return replace(
            reading,
            latitude_deg=place.latitude_deg,
            longitude_deg=place.longitude_deg,
            altitude_m=place.altitude_m,
            velocity_ned_m_s=rotate(turn, reading.velocity_ned_m_s),
        )
    old = reading.pose
    position = rotate(turn, old.position_ned_m) if about_origin else old.position_ned_m
    velocity = reading.velocity_ned_m_s
    return replace(
        reading,
        pose=Pose(add(position, moved.position_ned_m), quat_multiply(turn, old.q_wxyz)),
        velocity_ned_m_s=None if velocity is None else rotate(turn, velocity),
    )


class MountPart(Part):
    """A sensor's mount in the body's FRD frame.

    forward_m, right_m, down_m: from the body's centre to the sensor. rotation: turn of the sensor
    on the body.
    """

    forward_m: Metres = 0.0
    right_m: Metres = 0.0
    down_m: Metres = 0.0
    rotation: RotationPart = RotationPart()

    def pose(self) -> Pose:
        """Return the sensor's mount as a pose in the body's FRD frame."""
        return Pose((self.forward_m, self.right_m, self.down_m), self.rotation.quaternion())


class RemountParameters(SidedParameters):
    """to: the frame of the remounted points: the other side's mount, the body, or a mount."""

    shorthand = "to"

    to: Literal["real", "twin", "body"] | MountPart

    @model_validator(mode="after")
    def _not_to_itself(self) -> "RemountParameters":
        """Refuse a remount to the side's own mount."""
        refuse_own_side(self, self.to, "mount")
        return self


@step("remount", stage="transform", sensors=("lidar_points",), parameters=RemountParameters)
def remount(parameters: RemountParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Convert points into the frame of a sensor that is mounted elsewhere on the body.

    points_frd_m (points, 3) float32, metres forward, right, down of the sensor.
    """
    to = parameters.to
    fixed = (
        to.pose() if isinstance(to, MountPart) else Pose((0.0, 0.0, 0.0)) if to == "body" else None
    )

    def operator(
        work: Masked[LidarPointsReading], other: Masked[LidarPointsReading] | None
    ) -> Masked[LidarPointsReading]:
        mount = fixed
        if mount is None:
            if other is None:
                raise CannotMixError(
                    "no_real" if to == "real" else "no_twin",
                    f"remount to {to}: there is no reading of {to}",
                )
            mount = other.reading.mount
        return Masked(remounted_points(work.reading, mount), work.mask)

    return operator


def remounted_points(reading: LidarPointsReading, mount: Pose) -> LidarPointsReading:
    """Return the points in the frame of a sensor mounted at `mount` (in the body's FRD frame)."""
    if reading.mount == mount:
        return reading
    between = mount.inverse().compose(reading.mount)
    points = reading.points_frd_m @ matrix_from_quat(between.q_wxyz).T + between.position_ned_m
    return replace(reading, points_frd_m=points.astype(np.float32), mount=mount)
