"""Transforms between geodetic and local positions, and of scans and depth images into points."""

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from wil_campaign.recipes.model.registry import SidedParameters, StepContext, step
from wil_campaign.recipes.operations.masks import kept_elements
from wil_campaign.recipes.working import AnyMasked, Masked, Operator
from wil_campaign.vehicles.readings import (
    DepthReading,
    GpsReading,
    LidarPointsReading,
    LidarScanReading,
    PoseReading,
)
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import IDENTITY, Pose, quat_from_euler
from wil_campaign.worlds.geodesy import LocalFrame


class OriginParameters(SidedParameters):
    """The place of the local frame's origin on WGS-84.

    latitude_deg, longitude_deg: of the origin, the point whose north, east and up are 0.
    altitude_m: of the origin, above the ellipsoid as the altitudes of fixes.
    """

    latitude_deg: Annotated[float, Field(ge=-90, le=90)]
    longitude_deg: Annotated[float, Field(ge=-180, le=180)]
    altitude_m: float = 0.0

    def frame(self) -> LocalFrame:
        """Return the local frame at the origin's place on Earth."""
        return LocalFrame(self.latitude_deg, self.longitude_deg, self.altitude_m)


class GeodeticParameters(OriginParameters):
    """accuracy_m: the accuracy of the geodetic place, one standard deviation."""

    accuracy_m: Annotated[float, Field(ge=0)] = 0.0


@step(
    "geodetic",
    stage="transform",
    sensors=("pose",),
    parameters=GeodeticParameters,
    gives={"pose": "gps"},
)
def geodetic(parameters: GeodeticParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Convert a local position into a fix: NED metres into latitude, longitude (deg), altitude (m).

    The attitude is dropped; a pose without velocity gives 0 m/s.
    """
    frame = parameters.frame()

    def operator(work: Masked[PoseReading], other: AnyMasked | None) -> Masked[GpsReading]:  # noqa: ARG001 - the interface
        reading = work.reading
        place = frame.to_geodetic(reading.pose.position_ned_m)
        fix = GpsReading(
            t_s=reading.t_s,
            arrived_s=reading.arrived_s,
            seq=reading.seq,
            source=reading.source,
            latitude_deg=place.latitude_deg,
            longitude_deg=place.longitude_deg,
            altitude_m=place.altitude_m,
            velocity_ned_m_s=reading.velocity_ned_m_s or (0.0, 0.0, 0.0),
            horizontal_accuracy_m=parameters.accuracy_m,
            vertical_accuracy_m=parameters.accuracy_m,
        )
        return Masked(fix, work.mask)

    return operator


@step(
    "local",
    stage="transform",
    sensors=("gps",),
    parameters=OriginParameters,
    gives={"gps": "pose"},
)
def local(parameters: OriginParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Convert a fix into a local position: latitude, longitude (deg), altitude (m) into NED metres.

    A fix has no attitude: the pose is level, with the direction of the velocity over ground, or
    north when that is below 0.5 m/s.
    """
    frame = parameters.frame()

    def operator(work: Masked[GpsReading], other: AnyMasked | None) -> Masked[PoseReading]:  # noqa: ARG001 - the interface
        fix = work.reading
        position = frame.to_ned(fix.latitude_deg, fix.longitude_deg, fix.altitude_m)
        north, east, _ = fix.velocity_ned_m_s
        moving = math.hypot(north, east) > _MOVING_M_S
        attitude = quat_from_euler(0.0, 0.0, math.atan2(east, north)) if moving else IDENTITY
        pose = PoseReading(
            t_s=fix.t_s,
            arrived_s=fix.arrived_s,
            source=fix.source,
            pose=Pose(position, attitude),
            velocity_ned_m_s=fix.velocity_ned_m_s,
            seq=fix.seq,
        )
        return Masked(pose, work.mask)

    return operator


_MOVING_M_S = 0.5


class ToPointsParameters(SidedParameters):
    """every: uses each n-th beam, or each n-th pixel of each n-th row."""

    every: Annotated[int, Field(ge=1, le=1000)] = 1


@step(
    "to_points",
    stage="transform",
    sensors=("lidar", "depth"),
    parameters=ToPointsParameters,
    gives={"lidar": "lidar_points", "depth": "lidar_points"},
)
def to_points(parameters: ToPointsParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Convert a scan or a depth image into points: metres forward, right, down of the sensor.

    ranges_m (beams,) or depth_m (height, width) to points_frd_m (points, 3) float32; an element
    that is not kept, or has no return, has no point.
    """
    every = parameters.every

    def operator(
        work: Masked[LidarScanReading] | Masked[DepthReading],
        other: AnyMasked | None,  # noqa: ARG001 - the interface
    ) -> Masked[LidarPointsReading]:
        reading, keep = work.reading, kept_elements(work)
        if isinstance(reading, LidarScanReading):
            cloud = _points_of_scan(reading, keep, every)
        else:
            cloud = _points_of_depth(reading, keep, every)
        return Masked(
            LidarPointsReading(
                t_s=reading.t_s,
                arrived_s=reading.arrived_s,
                seq=reading.seq,
                source=reading.source,
                points_frd_m=cloud.points,
                object_ids=cloud.ids,
                mount=reading.mount,
            )
        )

    return operator


@dataclass(frozen=True, slots=True)
class _Points:
    """The points of a scan or depth image with their object ids."""

    points: NDArray[np.float32]
    ids: NDArray[np.uint8] | None


def _points_of_scan(scan: LidarScanReading, keep: NDArray[np.bool_], every: int) -> _Points:
    """Return the points of a scan's kept beams in the sensor's frame."""
    chosen = (keep & np.isfinite(scan.ranges_m))[::every]
    angles, ranges = scan.angles_rad[::every][chosen], scan.ranges_m[::every][chosen]
    points = np.stack([ranges * np.cos(angles), ranges * np.sin(angles), np.zeros(len(ranges))], 1)
    ids = None if scan.object_ids is None else scan.object_ids[::every][chosen]
    return _Points(points.astype(np.float32), ids)


def _points_of_depth(reading: DepthReading, keep: NDArray[np.bool_], every: int) -> _Points:
    """Return the points of a depth image in the camera's FRD frame, ignoring distortion."""
    steps = (slice(None, None, every), slice(None, None, every))
    depth = reading.depth_m[steps]
    chosen = keep[steps] & np.isfinite(depth)
    right, down = _slopes(reading.intrinsics)
    forward = depth[chosen]
    across = np.broadcast_to(right[::every], depth.shape)[chosen]
    below = np.broadcast_to(down[::every, None], depth.shape)[chosen]
    points = np.stack([forward, forward * across, forward * below], 1).astype(np.float32)
    ids = None if reading.object_ids is None else reading.object_ids[steps][chosen]
    return _Points(points, ids)


def _slopes(camera: Intrinsics) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the slopes of a depth camera's pixel columns and rows, to place points."""
    u = np.arange(camera.width_px, dtype=np.float64)
    v = np.arange(camera.height_px, dtype=np.float64)
    return (u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px
