"""What flights need of time and disk, as text: from the last ones of a campaign, else a guess."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.case_setup import FLIES, Case
from wil_campaign.campaigns.values.sensor_setups import CameraSetup, DepthSetup
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.foundation.files.limited_json import loads_limited_json
from wil_campaign.foundation.files.paths import file_sizes
from wil_campaign.orchestrator.cli.text_table import count_text
from wil_campaign.vehicles.embedded.physics.motion_kernel import estimate_motion
from wil_campaign.worlds.jit import is_kernel_cached
from wil_campaign.worlds.render.shading import write_ids

_GUESSED_S: dict[Clock, float] = {"virtual": 6.0, "wall": 60.0, "scaled": 60.0}
"""Wall time of one flight where nothing was flown yet: of the examples on two cores."""
_GUESSED_MB = 7.0
"""Disk of one flight with images of one camera, of which those that are drawn are not recorded."""
_IMAGES_S = 18.0
"""Time with images of a flight of the examples, from its takeoff to its landing."""
_DEPTH_BYTES_PX = 2.0
"""Disk of a pixel of a depth image with its object ids, exact and compressed: 2.2 in mode sim, 1.7
in mode wil, of images of 320x240 in an empty hall."""
_BYTES_PX: dict[str, float] = {"none": 0.0, "jpeg": 0.27, "needed": 0.27, "png": 1.5, "raw": 3.6}
"""Disk of a pixel of a recorded colour image, by `record.pictures` (docs/recording.md)."""
_MUCH_MB = 1000.0


@dataclass(frozen=True, slots=True)
class FlightNeeds:
    """What one flight needs: wall time, and disk in MB. is_known: measured, not guessed."""

    wall_s: float
    disk_mb: float
    is_known: bool


def flight_needs(folder: Path, clock: Clock, *, images_mb: Sequence[float] = ()) -> FlightNeeds:
    """Return what one flight of a campaign needs. folder: of its flights.

    images_mb: of each flight, as `images_mb_of` has it, for a guess.
    """
    more_mb = sum(images_mb) / max(1, len(images_mb))
    guess = FlightNeeds(_GUESSED_S[clock], _GUESSED_MB + more_mb, False)
    return _last_needs(folder, clock) or guess


def needs_text(needs: FlightNeeds, *, flights: int, at_once: int) -> str:
    """Return what flights need: about how long, and how many MB."""
    wall_s = needs.wall_s * math.ceil(flights / max(1, at_once))
    how = "as last time" if needs.is_known else "a guess"
    return f"about {_duration_text(wall_s)} and {_rounded(needs.disk_mb * flights)} MB ({how})"


def disk_warning(needs: FlightNeeds, *, flights: int, free_mb: float) -> str | None:
    """Return a warning of flights that need much disk, or half of what is free; None for others."""
    wanted_mb = needs.disk_mb * flights
    if wanted_mb <= _MUCH_MB and wanted_mb <= free_mb / 2.0:
        return None
    how = "as last time" if needs.is_known else "by the rates and sizes of images, 18 s a flight"
    return (
        f"warning: {count_text(flights, 'flight')} may write {_size_text(wanted_mb)} ({how}); "
        f"{_size_text(free_mb)} are free. Depth images and `record.pictures` other than needed "
        "take most: lower rate_hz, width_px and height_px where the test does not need them"
    )


def images_mb_of(case: Case, mode: Mode) -> float:
    """Return the MB of a flight's images beyond those of `record.pictures: needed` of cameras.

    Depth images are always recorded, with their object ids: of each vehicle and their mixture.
    """
    pictures, total_mb = case.record.pictures, 0.0
    for name in FLIES[mode]:
        copies = 2 if (mode, name) == ("wil", "real") else 1  # a mixture has the real one's size
        for sensor in case.vehicles[name].sensors:
            if isinstance(sensor, DepthSetup):
                total_mb += copies * _stream_mb(sensor, _DEPTH_BYTES_PX)
            elif isinstance(sensor, CameraSetup) and (pictures != "needed" or sensor.source):
                total_mb += copies * _stream_mb(sensor, _BYTES_PX[pictures])
    return total_mb


def _stream_mb(sensor: CameraSetup | DepthSetup, bytes_px: float) -> float:
    pixels = sensor.intrinsics.width_px * sensor.intrinsics.height_px
    return pixels * sensor.rate_hz * _IMAGES_S * bytes_px / 1e6


def _last_needs(folder: Path, clock: Clock) -> FlightNeeds | None:
    """Return what the newest flights beneath a folder needed by the same clock; None without."""
    try:
        flown = sorted((path for path in folder.iterdir() if path.is_dir()), reverse=True)
    except OSError:
        return None
    for path in flown[:3]:
        walls_s = list(_wall_times_s(path / "summary.json", clock))
        if walls_s:
            size_mb = sum(file_sizes(path).values()) / 1e6
            return FlightNeeds(sum(walls_s) / len(walls_s), size_mb / len(walls_s), True)
    return None


def _wall_times_s(summary: Path, clock: Clock) -> Iterator[float]:
    try:
        document = loads_limited_json(summary.read_bytes())
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


def _duration_text(wall_s: float) -> str:
    if wall_s < 55.0:
        return f"{max(5, math.ceil(wall_s / 5.0) * 5)} s"
    minutes = math.ceil(wall_s / 60.0)
    if minutes < 90:
        return "1 minute" if minutes == 1 else f"{minutes} minutes"
    return f"{wall_s / 3600.0:.1f} hours"


def _size_text(size_mb: float) -> str:
    return f"{size_mb / 1000.0:.1f} GB" if size_mb >= 1000.0 else f"{size_mb:.0f} MB"


def _rounded(value: float) -> int:
    """Return a number with two digits that count."""
    step: int = 10 ** max(0, len(str(int(value))) - 2)
    return max(1, math.ceil(value / step) * step)


NOTICE = "compiling kernels, once: about 20 s, more on a busy machine"
"""Wall time of `python -m tests.kernels` with an empty cache, on a free core."""


def compilation_notice(campaign: Campaign) -> str | None:
    """Return the line about kernels that the first flight compiles; None when all are cached."""
    return None if all(map(is_kernel_cached, _kernels(campaign))) else NOTICE


def _kernels(campaign: Campaign) -> Iterator[Callable[..., object]]:
    """Yield one kernel of each kind that the warm-up of a campaign's flights always loads."""
    vehicles = [
        vehicle for setup in campaign.setups.values() for vehicle in setup.vehicles.values()
    ]
    if any(vehicle.embedded for vehicle in vehicles):
        yield estimate_motion
    if any(
        isinstance(sensor, CameraSetup | DepthSetup)
        for vehicle in vehicles
        for sensor in vehicle.sensors
    ):
        yield write_ids
