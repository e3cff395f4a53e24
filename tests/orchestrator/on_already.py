"""Embedded vehicles that are on for a minute already, as those on the wall clock, and land at once.

Boot and landing are no matter of most flights: 6 s of each with PX4, 40 s with ArduCopter, and 4 s.
"""

import multiprocessing.util
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wil_campaign.orchestrator.run.vehicles import vehicle_backends

ROOT = Path(__file__).parents[2]
ASKS = "WIL_TESTS_VEHICLES_ON"
"""The variable by which a run asks for such vehicles."""
_LANDING = {
    "px4": {"MPC_LAND_CRWL": 0.7, "COM_DISARM_LAND": 0.3},
    "ardupilot": {"LAND_SPEED": 70.0},
}
_Config = vars(vehicle_backends)["EmbeddedConfig"]


def on_already(*, autopilot: str, parameters: dict[str, float], **more: Any) -> Any:
    """Return the config of such a vehicle, in the place of EmbeddedConfig."""
    return _Config(
        autopilot=autopilot,
        parameters={**_LANDING[autopilot], **parameters},
        running_s=60.0,
        **more,
    )


def where_asked(**given: Any) -> Any:
    """Return it where the environment of a run asks for it, else the config as given."""
    return on_already(**given) if ASKS in os.environ else _Config(**given)


def in_run_servers() -> None:
    """Have the run server that this process starts fly such vehicles where a run asks for it."""
    start: Any = multiprocessing.util.spawnv_passfds
    first = (
        f"import sys; sys.path.append({str(ROOT)!r}); from tests.orchestrator import on_already; "
        "on_already.vehicle_backends.EmbeddedConfig = on_already.where_asked; "
    )

    def started(path: bytes, words: Sequence[str], descriptors: Sequence[int]) -> int:
        if "multiprocessing.forkserver" in words[-1]:
            words = [*words[:-1], first + words[-1]]
        return int(start(path, words, descriptors))

    setattr(multiprocessing.util, "spawnv_passfds", started)  # noqa: B010 - a function is replaced
