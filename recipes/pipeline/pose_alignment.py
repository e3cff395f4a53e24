"""Align the worlds in time: from which pose the twin's image is to be taken."""

from wil_campaign.recipes.working import AlignedPose, PoseRequest
from wil_campaign.vehicles.poses.pose_history import PoseHistory


def align_pose(
    request: PoseRequest, history: PoseHistory, *, exposure_s: float, now_s: float
) -> AlignedPose | None:
    """Return the body's pose aligned with an image's exposure; None when no sample is near.

    history: of the vehicle that the request names. now_s: `latest` uses the samples known by then.
    The result's time is that of the pose, so that the skew of a mixture shows it.
    """
    if request.align == "interpolate":
        aligned = _interpolate_pose(history, exposure_s)
    else:
        aligned = _hold_pose(history, exposure_s if request.align == "hold" else now_s, exposure_s)
        aligned = aligned and AlignedPose(aligned.pose, aligned.t_s, request.align, aligned.gap_s)
    return aligned if aligned is not None and aligned.gap_s <= request.max_gap_s else None


def _interpolate_pose(history: PoseHistory, exposure_s: float) -> AlignedPose | None:
    """Return the pose aligned to an exposure by interpolation; None without a pose."""
    found = history.at(exposure_s)
    if found.pose is None:
        return None
    t_s = exposure_s - found.gap_s if found.kind == "latest" else exposure_s
    return AlignedPose(found.pose, t_s, found.kind, found.gap_s)


def _hold_pose(history: PoseHistory, until_s: float, exposure_s: float) -> AlignedPose | None:
    """Return the pose aligned to an exposure by hold: the last sample before a time."""
    sample = history.sample_before(until_s)
    if sample is None:
        return None
    t_s, pose = sample
    return AlignedPose(pose, t_s, "hold", abs(exposure_s - t_s))
