"""What embedded autopilots do when nobody speaks to them any more: they land.

As the autopilots ship, ArduCopter hovers on and PX4 stays in Hold, until the battery is empty.
"""

from collections.abc import Mapping

from vehicles.autopilots.base import AutopilotName

_SILENT_S = 5.0
"""Longer than the guard takes to call a vehicle lost, so that it acts first."""
_ARDUPILOT_LAND, _PX4_LAND = 5.0, 3.0

FAILSAFES: Mapping[AutopilotName, Mapping[str, float]] = {
    "ardupilot": {"FS_GCS_ENABLE": _ARDUPILOT_LAND, "FS_GCS_TIMEOUT": _SILENT_S},
    "px4": {"NAV_DLL_ACT": _PX4_LAND, "COM_DL_LOSS_T": _SILENT_S},
}
"""Parameters by autopilot; a campaign's own `params` win."""
