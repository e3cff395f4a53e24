"""The modes of PX4 by their numbers."""

import pytest

from wil_campaign.vehicles.embedded.autopilot.px4.px4_modes import (
    Px4Mode,
    mode_of_flags,
    px4_mode,
)


@pytest.mark.parametrize("mode", list(Px4Mode))
def test_px4_modes_are_found_by_their_numbers(mode: Px4Mode) -> None:
    assert px4_mode(mode.custom_mode >> 16 & 0xFF, mode.custom_mode >> 24) is mode


def test_unknown_px4_modes_are_none() -> None:
    assert px4_mode(4, 99) is None
    assert px4_mode(99, 0) is None


@pytest.mark.parametrize(
    ("flags", "mode"),
    [
        (0, None),
        (16, None),
        (4, Px4Mode.MISSION),
        (64, Px4Mode.MANUAL),
        (80, Px4Mode.STABILIZED),
        (88, Px4Mode.POSITION),
    ],
)
def test_flags_without_a_custom_mode_name_old_modes(flags: int, mode: Px4Mode | None) -> None:
    """Commander::handle_command, DO_SET_MODE; AUTO without a sub mode is MISSION too."""
    assert mode_of_flags(flags) is mode
    assert px4_mode(4, 0) is Px4Mode.MISSION
