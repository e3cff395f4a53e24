"""The STATUSTEXTs that a guard's event is explained by: those that may be its cause."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from wil_campaign.orchestrator.run.flight.conduct import last_statustext
from wil_campaign.safety.guard.core.events import GuardEvent
from wil_campaign.vehicles.driver.vehicle_state import StatusText

ARMED = StatusText(11.0, 6, "Armed by external command")
AIRBORNE = StatusText(13.0, 6, "Takeoff detected")
LOW = StatusText(14.0, 4, "Battery low, return advised")
HIT = StatusText(19.5, 6, "SIM Hit ground at 3.1 m/s")


@pytest.mark.parametrize(
    ("texts", "received_s", "said"),
    [
        ([ARMED, AIRBORNE], 20.0, ""),
        ([ARMED, AIRBORNE, LOW], 20.0, "Battery low, return advised (6 s before)"),
        ([ARMED, AIRBORNE, HIT], 20.0, "SIM Hit ground at 3.1 m/s"),
        ([replace(LOW, t_s=4.0)], 20.0, ""),  # of the preflight
        # It has been silent since: this was the last that it said.
        ([ARMED, AIRBORNE], 14.0, "Takeoff detected (7 s before)"),
    ],
)
def test_a_vehicles_end_is_explained_by_its_warnings_and_its_last_texts(
    texts: list[StatusText], received_s: float, said: str
) -> None:
    state = SimpleNamespace(texts=tuple(texts), last_received_s=received_s)
    context = SimpleNamespace(name="twin", driver=SimpleNamespace(state=state))
    pair = cast("Any", SimpleNamespace(contexts=(context,), actors=()))
    event = GuardEvent(20.0, "alone", vehicle="twin", text="twin is 0.2 m outside")
    found = last_statustext(pair, event, armed_s=10.0)
    assert found == (f"; its last STATUSTEXT: {said}" if said else "")
