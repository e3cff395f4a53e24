"""When the console's server holds a vehicle for down."""

import pytest
from msgspec import structs

from tests.plugins.console.test_page_truth import vehicle, view
from wil_campaign.plugins.console.console_hub import DownTimes
from wil_campaign.plugins.console.feed.feed_messages import EventView, RunView


def state(*, armed: bool, landed: str, t_s: float = 10.0) -> RunView:
    return view("large/wil/1", vehicles=(vehicle("real", armed=armed, landed=landed),), t_s=t_s)


@pytest.mark.parametrize(
    ("armed", "landed", "is_down"),
    [
        (False, "on_ground", True),
        (False, "", True),
        (True, "on_ground", False),
        (True, "", False),
        (False, "in_air", False),
    ],
)
def test_a_vehicle_is_down_when_it_is_disarmed_on_the_ground(
    armed: bool, landed: str, is_down: bool
) -> None:
    times = DownTimes()
    times.receive_view(state(armed=armed, landed=landed), 5.0)
    assert times.at_s == ({"real": 5.0} if is_down else {})


def test_the_first_time_stays_until_the_vehicle_is_up_again() -> None:
    times = DownTimes()
    for at_s in (5.0, 6.0):
        times.receive_view(state(armed=False, landed="on_ground"), at_s)
        times.add("real", at_s + 0.5)
    assert times.at_s == {"real": 5.0}
    times.receive_view(state(armed=True, landed="on_ground"), 7.0)
    assert times.at_s == {}


def test_a_vehicle_without_a_message_is_not_down() -> None:
    times = DownTimes()
    silent = structs.replace(vehicle("real", armed=False, landed="on_ground"), silent_s=None)
    times.receive_view(view("large/wil/1", vehicles=(silent,)), 5.0)
    assert times.at_s == {}


@pytest.mark.parametrize(
    ("kind", "word", "said", "t_s", "is_landing"),
    [
        ("vehicle", "disarmed", "", 10.0, True),
        ("guard", "phase", "real: down", 10.0, True),
        ("guard", "phase", "real: descending", 10.0, False),
        ("vehicle", "text", "real: down", 10.0, False),
        ("vehicle", "disarmed", "", 9.0, False),
    ],
)
def test_an_event_is_a_landing_unless_a_newer_state_is_there(
    kind: str, word: str, said: str, t_s: float, is_landing: bool
) -> None:
    times = DownTimes()
    newest = state(armed=True, landed="in_air")
    event = EventView(newest.run, 1, t_s, kind, word, "real", said)
    assert times.receive_event(event, None, 5.0) is None
    assert times.receive_event(event, newest, 6.0) == (6.0 if is_landing else None)
    assert times.at_s == ({"real": 6.0} if is_landing else {})
