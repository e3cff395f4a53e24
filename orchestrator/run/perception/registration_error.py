"""Registration error: pixel distance of drawn virtual objects from their true place."""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence

from wil_campaign.campaigns.setup.case_setup import VehicleSetup
from wil_campaign.campaigns.values.external_setups import PoseAccuracy, ShownAs
from wil_campaign.campaigns.values.sensor_setups import CameraSetup, DepthSetup
from wil_campaign.orchestrator.run.perception.mixing_loop import Registration, RegistrationError
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.vehicles.autopilots.autopilot import Autopilot
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.mavlink.names import message_name
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.readings import CameraReading, DepthReading, Reading
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, Vec3, norm
from wil_campaign.worlds.scene.scene import SceneObject

Pictured = CameraSetup | DepthSetup
_REPORTED_S = 3.0
"""How long a reported accuracy holds; it is requested twice a second."""
_NO_POSE = "{} has no pose near the exposure"


class Registrar:
    """Measures the registration error of overlays against the real camera's true pose."""

    def __init__(
        self,
        *,
        setup: RunSetup,
        contexts: Mapping[str, VehicleContext],
        events: Mapping[str, float],
    ) -> None:
        real = set(setup.real_scene.names)
        self._virtual = [
            (thing, box_corners(thing))
            for thing in setup.virtual_scene.objects
            if thing.name not in real
        ]
        self._setup = setup
        self._contexts = contexts
        self._events = events

    def of(self, camera: Pictured) -> Registration:
        """Return the measurement of the registration error of twin images over a real camera's.

        It measures nothing for an image of unknown pose, nor where nothing virtual is in view.
        The truth of an embedded vehicle is no reference for external images, and a simulator's
        ground truth is none for images which that simulator rendered. The bound includes what the
        vehicle moves while the newest pose is older than the exposure, and within the uncertainty
        of its clock: as it moved in so much time before.
        """
        twin_camera = _camera_setup(self._setup.vehicle("twin"), camera.name)
        is_live_twin = twin_camera is not None and _image_source_name(twin_camera) == "live"
        real, shown_as = self._contexts["real"], _image_source_name(camera)
        vehicle = self._setup.vehicle("real")
        independent = vehicle.embedded or vehicle.pose_source != "simulator"
        has_truth = shown_as == "rendered" and independent

        def registered(twin: Reading, exposed_s: float) -> RegistrationError:
            drawn_from, drawn_before = self._drawn_from(twin, twin_camera)
            truth = real.truth.at(exposed_s).pose if has_truth else None
            reference = real.poses.at(exposed_s).pose if truth is None else truth
            if shown_as == "file" or (drawn_from is None and not is_live_twin):
                return RegistrationError()
            if drawn_from is None or reference is None:
                name = "twin" if drawn_from is None else "real"
                return RegistrationError(unbounded=_NO_POSE.format(name))
            corners, here = self._corners(exposed_s), camera.mount.camera_pose(reference)
            seen = seen_points(
                zip(self._corners(twin.t_s), corners, strict=True),
                intrinsics=camera.intrinsics,
                drawn_from=drawn_from,
                reference=here,
            )
            error_px = registration_error_px(seen)
            if truth is not None or error_px is None:
                return RegistrationError(error_px)
            accuracy = self._accuracy(exposed_s)
            if isinstance(accuracy, str):
                return RegistrationError(unbounded=accuracy)
            clock_s = self._clock_doubt_s() if shown_as == "live" else 0.0
            before = _pose_before(real.poses, exposed_s, clock_s)
            if before is None or drawn_before is None:
                name = "real" if before is None else "twin"
                return RegistrationError(unbounded=_NO_POSE.format(name))
            points, lens = [point for point, _ in seen], camera.intrinsics
            doubt_px = uncertainty_px(points, intrinsics=lens, camera=here, accuracy=accuracy)
            doubt_px += moved_px(points, lens, camera.mount.camera_pose(before), here)
            doubt_px += moved_px(points, lens, drawn_before, drawn_from)
            return RegistrationError(bound_px=error_px + doubt_px)

        return registered

    def _clock_doubt_s(self) -> float:
        """Return by how much the real vehicle's poses may be off in time beside live images."""
        if self._setup.vehicle("real").pose_source == "mocap":
            return 0.0
        return self._contexts["real"].driver.clock.uncertainty_s or 0.0

    def _drawn_from(
        self, twin: Reading, camera: Pictured | None
    ) -> tuple[Pose | None, Pose | None]:
        """Return the pose a twin's image was rendered from, and `_pose_before` it.

        For a live camera it is the twin's own; else it is known, and both are the same.
        """
        if not isinstance(twin, CameraReading | DepthReading):
            return None, None
        if twin.camera_pose is not None or camera is None or _image_source_name(camera) != "live":
            return twin.camera_pose, twin.camera_pose
        poses = self._contexts["twin"].poses
        bodies = poses.at(twin.t_s).pose, _pose_before(poses, twin.t_s, 0.0)
        here, before = (body and camera.mount.camera_pose(body) for body in bodies)
        return here, before

    def _accuracy(self, t_s: float) -> PoseAccuracy | str:
        """Return the accuracy of the real vehicle's pose, or in words why it is unknown.

        The error of an estimate depends on satellites and surroundings: only the estimator reports
        it, or the campaign states it.
        """
        vehicle = self._setup.vehicle("real")
        if not vehicle.reports_accuracy:
            return vehicle.pose_accuracy
        driver = self._contexts["real"].driver
        reported = driver.accuracy.newest
        if reported is not None and t_s - reported.arrived_s < _REPORTED_S:
            return PoseAccuracy(position_m=reported.position_m, attitude_rad=reported.attitude_rad)
        autopilot = autopilot_named(driver.identity.autopilot)
        return no_accuracy_text(autopilot)

    def _corners(self, t_s: float) -> list[Vec3]:
        return [
            pose.to_parent(corner)
            for thing, corners in self._virtual
            for pose in (thing.pose_at(t_s, self._events),)
            for corner in corners
        ]


def _pose_before(poses: PoseHistory, t_s: float, clock_s: float) -> Pose | None:
    """Return where a vehicle was before its pose at a moment, by the doubt of that pose's time.

    That is by how much its newest pose is older, and clock_s. Without doubt it is the same pose.
    """
    known = poses.at(t_s)
    late_s = known.gap_s if known.kind == "latest" else 0.0
    return poses.at(t_s - 2.0 * late_s - clock_s).pose if late_s + clock_s > 0.0 else known.pose


def no_accuracy_text(autopilot: Autopilot) -> str:
    """Return why nothing bounds the registration error of an estimate, and the remedy."""
    remedy = "state pose_accuracy of the real vehicle"
    if autopilot.accuracy_message_id is None:
        return f"{autopilot.label} reports no accuracy of its estimate in metres; {remedy}"
    name = message_name(autopilot.accuracy_message_id)
    return f"no covariance came in {autopilot.label}'s {name}; {remedy}"


def _camera_setup(vehicle: VehicleSetup, name: str) -> Pictured | None:
    sensors = (sensor for sensor in vehicle.sensors if sensor.name == name)
    return next(
        (sensor for sensor in sensors if isinstance(sensor, CameraSetup | DepthSetup)), None
    )


def _image_source_name(camera: Pictured) -> ShownAs:
    source = camera.source
    return "rendered" if source is None else source.shown_as


def seen_points(
    points_ned_m: Iterable[tuple[Vec3, Vec3]],
    *,
    intrinsics: Intrinsics,
    drawn_from: Pose,
    reference: Pose,
) -> list[tuple[Vec3, float]]:
    """Return the points that count, each with its pixel distance from where it should be.

    points_ned_m: points of virtual objects, world frame, each where it was drawn and where it
    was at the exposure of the real image, which is returned. drawn_from, reference: camera poses
    (FRD axes). Points in front of both cameras and within either image count.
    """
    seen: list[tuple[Vec3, float]] = []
    for shown, point in points_ned_m:
        drawn = intrinsics.project(drawn_from.to_local(shown))
        right = intrinsics.project(reference.to_local(point))
        if drawn is None or right is None:
            continue
        if _inside(drawn, intrinsics) or _inside(right, intrinsics):
            seen.append((point, math.dist(drawn, right)))
    return seen


def registration_error_px(seen: Sequence[tuple[Vec3, float]]) -> float | None:
    """Return the RMS pixel distance of seen points; None when there is none."""
    return _rms([apart_px for _, apart_px in seen]) if seen else None


def uncertainty_px(
    points_ned_m: Iterable[Vec3], *, intrinsics: Intrinsics, camera: Pose, accuracy: PoseAccuracy
) -> float:
    """Return the registration bound of points: three standard deviations of the pose.

    RMS over the points, which are in front of the camera, in pixels; 0 for none. To first order a
    camera that is moved by s across the ray to a point at distance d, depth z, sees it turned by
    s / d; an angle a moves it by up to f (d / z)^2 a pixels.
    """
    focal_px = max(intrinsics.fx_px, intrinsics.fy_px)
    doubts_px: list[float] = []
    for point in points_ned_m:
        local = camera.to_local(point)
        away_m = norm(local)
        angle_rad = math.hypot(accuracy.position_m / away_m, accuracy.attitude_rad)
        doubts_px.append(_SIGMAS * focal_px * (away_m / local[0]) ** 2 * angle_rad)
    return _rms(doubts_px)


def moved_px(
    points_ned_m: Iterable[Vec3], intrinsics: Intrinsics, before: Pose, now: Pose
) -> float:
    """Return by how many pixels seen points move between two camera poses, RMS."""
    pixels = (
        (intrinsics.project(before.to_local(point)), intrinsics.project(now.to_local(point)))
        for point in points_ned_m
    )
    return _rms([math.dist(old, new) for old, new in pixels if old and new])


def _rms(values: Sequence[float]) -> float:
    """Return the root mean square of values; 0 for none."""
    return math.sqrt(math.fsum(value * value for value in values) / max(1, len(values)))


_SIGMAS = 3.0


def box_corners(thing: SceneObject) -> tuple[Vec3, ...]:
    """Return the eight corners of an object's bounding box, in its own frame (FRD metres)."""
    low = [float(value) for value in thing.shape.mesh.vertices_m.min(axis=0)]
    high = [float(value) for value in thing.shape.mesh.vertices_m.max(axis=0)]
    sides = zip(low, high, strict=True)
    return tuple((north, east, down) for north, east, down in itertools.product(*sides))


def _inside(pixel: tuple[float, float], intrinsics: Intrinsics) -> bool:
    """Return whether a registered point lies in the image."""
    return (
        -0.5 <= pixel[0] <= intrinsics.width_px - 0.5
        and -0.5 <= pixel[1] <= intrinsics.height_px - 0.5
    )
