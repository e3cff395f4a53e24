"""Checks a fence from the page before it is sent to the runs, which decide on it; pure."""

from collections.abc import Iterable

from wil_campaign.campaigns.setup.vehicle_fences import changed_fences
from wil_campaign.orchestrator.live_feed.feed_messages import RunView
from wil_campaign.plugins.console.console_access import AccessError
from wil_campaign.safety.fence.areas import FenceError
from wil_campaign.safety.fence.fence_files import parse_fence_file
from wil_campaign.safety.fence.fence_values import fence_of_plain
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.worlds.files.documents import BadInput
from wil_campaign.worlds.geodesy import LocalFrame

_NOWHERE = LocalFrame(0.0, 0.0, 0.0)
"""The page draws in metres, so the origin on Earth does not matter."""


def check_fence(text: str, views: Iterable[RunView]) -> None:
    """Raise AccessError for an invalid fence, or one with a flying vehicle outside.

    Whether a vehicle can stop inside, and whether its autopilot accepts it, the run checks.
    """
    flying = [view for view in views if view.stage != "end"]
    try:
        present = [_fences(view) for view in flying]
        document = parse_fence_file(text.encode(), name="geofence")
        changed = changed_fences(document, _NOWHERE, present[-1] if present else {})
    except BadInput as error:
        why = "; ".join(problem.message for problem in error.problems)
        raise AccessError(f"geofence: {why}") from error
    except (FenceError, ValueError, KeyError, TypeError) as error:
        raise AccessError(f"geofence: {error}") from error
    fences: dict[str, Fence] = {str(name): fence for name, fence in changed.items()}
    for view in flying:
        for vehicle in view.vehicles:
            fence, position_ned_m = fences.get(vehicle.name), vehicle.position_ned_m
            if fence is None or position_ned_m is None:
                continue
            if (margin_m := fence.margin_m(position_ned_m)) < 0.0:
                raise AccessError(f"geofence: {vehicle.name} would be {-margin_m:.2f} m outside")


def _fences(view: RunView) -> dict[str, Fence]:
    return {name: fence_of_plain(plain) for name, plain in view.fences.items()}
