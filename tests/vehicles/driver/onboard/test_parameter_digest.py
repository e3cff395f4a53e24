"""The digest of a vehicle's parameters: of a whole list, or none."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.driver.onboard.parameter_digest import ParameterDigest

VALUES = {"WPNAV_SPEED": 500.0, "ATC_ANGLE_MAX": 30.0, "FRAME_CLASS": 1.0}


class Listening:
    """A session that keeps who listens, and what was sent."""

    def __init__(self) -> None:
        self.listeners: list[Any] = []
        self.sent: list[Any] = []

    def on(self, _: int, listener: Any) -> None:
        self.listeners.append(listener)

    def send(self, message: Any) -> None:
        self.sent.append(message)


def digest_of(values: dict[str, float], *, count: int) -> str:
    session = Listening()
    digest = ParameterDigest(session=cast("Any", session))
    digest.begin(autopilot_named("ardupilot"), MavlinkTarget(1))
    for index, (name, value) in enumerate(values.items()):
        message = SimpleNamespace(
            param_id=name, param_value=value, param_type=9, param_count=count, param_index=index
        )
        for listener in session.listeners:
            listener(message, 0.0)
    digest.settle()
    return digest.text


def test_a_list_that_did_not_arrive_whole_has_no_digest() -> None:
    assert digest_of(VALUES, count=len(VALUES) + 1) == ""
    assert digest_of(VALUES, count=len(VALUES))


@pytest.mark.parametrize("name", VALUES)
def test_a_changed_value_changes_the_digest(name: str) -> None:
    whole = len(VALUES)
    changed = digest_of(VALUES | {name: 7.0}, count=whole)
    assert changed != digest_of(VALUES, count=whole) == digest_of(VALUES, count=whole)
