"""What `run` says when its first flight compiles kernels, and would be silent meanwhile."""

from collections.abc import Callable, Iterator

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.campaigns.values.sensor_setups import CameraSetup, DepthSetup
from wil_campaign.vehicles.embedded.physics.motion_kernel import estimate
from wil_campaign.worlds.jit import is_cached
from wil_campaign.worlds.render.shading import write_ids

NOTICE = "compiling kernels, once: about 20 s, more on a busy machine"
"""Wall time of `python -m tests.kernels` with an empty cache, on a free core."""


def compilation_notice(campaign: Campaign) -> str | None:
    """Return the line about kernels that the first flight compiles; None when all are cached."""
    return None if all(map(is_cached, _kernels(campaign))) else NOTICE


def _kernels(campaign: Campaign) -> Iterator[Callable[..., object]]:
    """Yield one kernel of each kind that the warm-up of a campaign's flights always loads."""
    vehicles = [one for setup in campaign.setups.values() for one in setup.vehicles.values()]
    if any(one.embedded for one in vehicles):
        yield estimate
    if any(
        isinstance(sensor, CameraSetup | DepthSetup) for one in vehicles for sensor in one.sensors
    ):
        yield write_ids
