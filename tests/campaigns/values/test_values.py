"""Values of a campaign that decide by themselves: clocks, limits of the autonomy, faults."""

import pytest

from wil_campaign.campaigns.values.autonomy_limits import AutonomyLimits
from wil_campaign.campaigns.values.expectation import Expectation
from wil_campaign.campaigns.values.external_setups import (
    ReadingSourceSetup,
    ShownAs,
    SourceKind,
    SourceSetup,
)
from wil_campaign.campaigns.values.signal_faults import SignalFault


@pytest.mark.parametrize(
    ("kind", "wall_clock", "shown_as"),
    [
        ("rtsp", True, "live"),
        ("v4l2", True, "live"),
        ("simulator", True, "rendered"),
        ("mcap", False, "file"),
        ("images", False, "file"),
        ("video", False, "file"),
    ],
)
def test_only_files_play_at_any_pace(kind: SourceKind, wall_clock: bool, shown_as: ShownAs) -> None:
    source = SourceSetup(kind=kind, address="x")
    assert source.needs_wall_clock is wall_clock
    assert source.shown_as == shown_as
    assert source.renders_on_request is (shown_as == "rendered")


def test_readings_of_the_vehicles_own_link_need_no_wall_clock() -> None:
    assert not ReadingSourceSetup(kind="mavlink", address="mavlink").needs_wall_clock
    assert ReadingSourceSetup(kind="zmq", address="tcp://127.0.0.1:5556").needs_wall_clock
    assert ReadingSourceSetup(kind="mcap", address="/x.mcap").shown_as == "file"


def test_memory_above_its_limit_is_reported_and_memory_at_it_is_not() -> None:
    limits = AutonomyLimits(memory_mb=100.0)
    assert limits.excess("it grew by", 100.0) == ""
    text = limits.excess("it grew by", 101.0)
    assert "it grew by 101 MB" in text
    assert "autonomy.limits.memory_mb is 100" in text
    assert "it grew by 100.4 MB" in limits.excess("it grew by", 100.4)


def test_a_fault_is_written_with_its_signal_time_and_duration() -> None:
    frozen = SignalFault(
        vehicle="real", sensor="camera", kind="freeze", stage="goal", after_s=1.5, for_s=0.5
    )
    said = "the autonomy's sensor camera of real freezes 1.5 s after stage goal for 0.5 s"
    assert str(frozen) == said
    stopped = SignalFault(vehicle="twin", sensor=None, kind="stop", stage="takeoff")
    assert str(stopped) == "the pose source of twin stops 0 s after stage takeoff"


def test_an_expectation_is_written_with_oracle_and_cause_where_it_has_them() -> None:
    assert str(Expectation("a", "ERROR")) == "ERROR"
    assert str(Expectation("a", "FAIL", "height", "2.3 m")) == "FAIL by height (2.3 m)"
