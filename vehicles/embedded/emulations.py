"""The emulated autopilots, the core's and the plugins', by the names in campaigns."""

from collections.abc import Mapping
from functools import cache
from typing import Any, Protocol

import numpy as np

from wil_campaign.hooks import autopilots
from wil_campaign.installed_plugins import loaded_additions
from wil_campaign.vehicles.embedded.autopilot.aircraft import EmulatedAircraft
from wil_campaign.vehicles.embedded.autopilot.emulated_autopilot import EmulatedAutopilot
from wil_campaign.vehicles.embedded.autopilot.flight.flight import FlightStyle
from wil_campaign.vehicles.embedded.control.kernels import LAW_NUMBERS
from wil_campaign.vehicles.embedded.physics.motion_kernel import (
    BODY_NUMBERS,
    NUMBERS,
    estimate_motion,
    read_plant_motion,
)


class Emulation(Protocol):
    """The class of an emulated autopilot (protocol)."""

    style: FlightStyle

    def __call__(self, aircraft: EmulatedAircraft) -> EmulatedAutopilot[Any]:
        """Return the autopilot, which flies an aircraft."""


@cache
def emulations() -> Mapping[str, Emulation]:
    """Return by name the classes of all emulated autopilots."""
    return loaded_additions(autopilots, "emulation")


def load_kernels() -> None:
    """Load the kernels of all control laws and of the body, or compile them: seconds, once.

    Called before a flight: at liftoff it would block the interpreter for as long.
    """
    motion, zero, errors, late = np.zeros(NUMBERS), np.zeros(3), np.zeros(9), np.zeros((1, 6))
    for emulation in emulations().values():
        law = emulation.style.law
        law.step(np.ones(LAW_NUMBERS), motion, 1)
        law.advance(np.ones(BODY_NUMBERS), late, 0, 1)
    read_plant_motion(motion, zero, motion)
    estimate_motion(motion, errors, late, 0, motion)
