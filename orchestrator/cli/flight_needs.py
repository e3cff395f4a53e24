"""What flights need of time and disk, as text: from the last ones of a campaign, else a guess."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.campaigns.values.sensor_setups import CameraSetup, DepthSetup
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.foundation.files.limited_json import loads_limited
from wil_campaign.vehicles.embedded.physics.motion_kernel import estimate
from wil_campaign.worlds.jit import is_cached
from wil_campaign.worlds.render.shading import write_ids

_GUESSED_S: dict[Clock, float] = {"virtual": 6.0, "wall": 60.0, "scaled": 60.0}
"""Wall time of one flight where nothing was flown yet: of the examples on two cores."""
_GUESSED_MB = 7.0
"""Disk of one flight with images of one camera."""


@dataclass(frozen=True, slots=True)
class FlightNeeds:
    """What one flight needs: wall time, and disk in MB. is_known: measured, not guessed."""

    wall_s: float
    disk_mb: float
    is_known: bool


def needs_text(folder: Path, *, flights: int, at_once: int, clock: Clock) -> str:
    """Return what flights need: about how long, how many MB. folder: of a campaign's flights."""
    needs = _last_needs(folder, clock) or FlightNeeds(_GUESSED_S[clock], _GUESSED_MB, False)
    wall_s = needs.wall_s * math.ceil(flights / max(1, at_once))
    how = "as last time" if needs.is_known else "a guess"
    return f"about {_duration_text(wall_s)} and {_rounded(needs.disk_mb * flights)} MB ({how})"


def _last_needs(folder: Path, clock: Clock) -> FlightNeeds | None:
    """Return what the newest flights beneath a folder needed by the same clock; None without."""
    try:
        flown = sorted((path for path in folder.iterdir() if path.is_dir()), reverse=True)
    except OSError:
        return None
    for path in flown[:3]:
        walls_s = list(_wall_times_s(path / "summary.json", clock))
        if walls_s:
            size_mb = sum(_sizes(path)) / 1e6
            return FlightNeeds(sum(walls_s) / len(walls_s), size_mb / len(walls_s), True)
    return None


def _wall_times_s(summary: Path, clock: Clock) -> Iterator[float]:
    try:
        document = loads_limited(summary.read_bytes())
    except (OSError, ValueError, RecursionError):
        return
    if not isinstance(document, dict) or document.get("clock") != clock:
        return
    for group in ("runs", "controls"):
        found = document.get(group)
        for run in found if isinstance(found, list) else ():
            wall_s = run.get("wall_s") if isinstance(run, dict) else None
            if isinstance(wall_s, int | float) and wall_s > 0.0:
                yield float(wall_s)


def _sizes(folder: Path) -> Iterable[int]:
    for path in folder.rglob("*"):
        try:
            yield path.lstat().st_size
        except OSError:
            continue  # it may just have been removed


def _duration_text(wall_s: float) -> str:
    if wall_s < 55.0:
        return f"{max(5, math.ceil(wall_s / 5.0) * 5)} s"
    minutes = math.ceil(wall_s / 60.0)
    if minutes < 90:
        return "1 minute" if minutes == 1 else f"{minutes} minutes"
    return f"{wall_s / 3600.0:.1f} hours"


def _rounded(value: float) -> int:
    """Return a number with two digits that count."""
    step: int = 10 ** max(0, len(str(int(value))) - 2)
    return max(1, math.ceil(value / step) * step)


NOTICE = "compiling kernels, once: about 20 s, more on a busy machine"
"""Wall time of `python -m tests.kernels` with an empty cache, on a free core."""


def compilation_notice(campaign: Campaign) -> str | None:
    """Return the line about kernels that the first flight compiles; None when all are cached."""
    return None if all(map(is_cached, _kernels(campaign))) else NOTICE


def _kernels(campaign: Campaign) -> Iterator[Callable[..., object]]:
    """Yield one kernel of each kind that the warm-up of a campaign's flights always loads."""
    vehicles = [
        vehicle for setup in campaign.setups.values() for vehicle in setup.vehicles.values()
    ]
    if any(vehicle.embedded for vehicle in vehicles):
        yield estimate
    if any(
        isinstance(sensor, CameraSetup | DepthSetup)
        for vehicle in vehicles
        for sensor in vehicle.sensors
    ):
        yield write_ids
