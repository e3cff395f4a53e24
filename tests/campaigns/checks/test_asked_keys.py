"""Keys of `autonomy.with` that an autonomy never reads are named; none is named wrongly."""

import copy
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.orchestrator.hover import CAMPAIGN, write_hover
from wil_campaign.campaigns.checks.autonomy_checks import unread_keys
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign

Build = Callable[[dict[str, object]], object]
GIVEN = {"speed_ms": 1.0, "gain": 2.0}


def takes(**parameters: object) -> int:
    """Take what a dataclass takes that is built by `**`."""
    return len(parameters)


@pytest.mark.parametrize(
    "build",
    [
        lambda given: given.get("speed_m_s", 0.5),
        lambda given: "speed_m_s" in given,
        lambda given: given.pop("gain"),
        lambda given: given.setdefault("speed_m_s", 0.5),
    ],
)
def test_a_key_that_is_not_asked_for_is_unread(build: Build) -> None:
    assert "speed_ms" in unread_keys(build, GIVEN)


@pytest.mark.parametrize(
    "build",
    [
        dict,
        set,
        copy.copy,
        copy.deepcopy,
        json.dumps,
        lambda given: takes(**given),
        lambda given: {**given},
        lambda given: given | {},
        lambda given: {} | given,
        lambda given: [key for key, _ in given.items()],
        lambda given: list(given.values()),
        lambda given: (given["speed_ms"], given["gain"]),
        {}.update,
        lambda given: given.copy(),
    ],
)
def test_a_copy_or_a_dump_counts_as_reading_every_key(build: Build) -> None:
    """It asks for a key first: of what asks for none nothing is reported anyway."""

    def asking(given: dict[str, object]) -> object:
        given.get("rate_hz")
        return build(given)

    assert unread_keys(asking, GIVEN) == {}


def test_code_that_keeps_the_parameters_or_reads_none_is_not_reported() -> None:
    """It may read it in flight, or by compiled code that asks no method of a dict."""
    assert unread_keys(lambda given: (given, given.get("gain")), GIVEN) == {}
    assert unread_keys(lambda given: (lambda: given["speed_ms"], given["gain"]), GIVEN) == {}
    assert unread_keys(lambda _: None, GIVEN) == {}


def test_the_key_that_was_meant_is_named() -> None:
    assert unread_keys(lambda given: given.get("speed_m_s"), {"speed_ms": 1.0}) == {
        "speed_ms": "speed_m_s"
    }


@pytest.mark.parametrize("is_isolated", [True, False])
def test_a_campaign_has_it_as_a_warning_with_its_place_and_as_a_caveat(
    tmp_path: Path, *, is_isolated: bool
) -> None:
    path = write_hover(tmp_path)
    used = "autonomy: {use: still.py:Still, with: {tick: 2}}"
    path.write_text(CAMPAIGN.replace("autonomy: still.py:Still", used))
    campaign = load_campaign(path, ExpansionOptions(is_autonomy_isolated=is_isolated))
    (warning,) = [one for one in campaign.warnings if "never read" in one.message]
    assert (warning.line, warning.suggestion) == (5, "ticks")
    assert warning.message == "the autonomy never read `tick` of its `with`"
    assert campaign.caveats == (warning.message,)


def test_a_key_that_the_autonomy_reads_gives_no_warning(tmp_path: Path) -> None:
    path = write_hover(tmp_path)
    used = "autonomy: {use: still.py:Still, with: {ticks: 2}}"
    path.write_text(CAMPAIGN.replace("autonomy: still.py:Still", used))
    assert load_campaign(path).caveats == ()
