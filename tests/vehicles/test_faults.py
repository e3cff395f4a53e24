"""Faults as texts: what there is, when it begins and ends, and what is refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.campaigns.schema.faults import SignalFaultPart
from wil_campaign.vehicles.faults import (
    LATEST_S,
    LONGEST_S,
    FaultTextError,
    InjectedFault,
    parse_fault,
)

moments = st.integers(0, 86_400_000).map(lambda ms: ms / 1000.0)
lengths = st.none() | st.integers(1, 3_600_000).map(lambda ms: ms / 1000.0)
for_good = st.builds(InjectedFault, st.sampled_from(["kill", "unmute"]), after_s=moments)
mutes = st.builds(InjectedFault, st.just("mute"), after_s=moments, for_s=lengths)
motors = st.builds(
    InjectedFault,
    st.just("motor"),
    st.integers(0, 3),
    st.floats(0.0, 2.0),
    after_s=moments,
    for_s=lengths,
)
signals = st.builds(
    InjectedFault,
    st.sampled_from(["pose_source", "estimate", "camera"]),
    kind=st.sampled_from(["stop", "freeze"]),
    after_s=moments,
    for_s=lengths,
)


@given(for_good | mutes | motors | signals)
def test_faults_survive_as_texts(fault: InjectedFault) -> None:
    assert parse_fault(str(fault)) == fault


def test_faults_are_read_as_people_write_them() -> None:
    assert parse_fault("motor@12") == InjectedFault("motor", 0, 0.0, after_s=12.0)
    assert parse_fault("motor 2") == InjectedFault("motor", 2, 0.0)
    assert parse_fault("mute @ 5+2") == InjectedFault("mute", after_s=5.0, for_s=2.0)
    assert parse_fault("pose_source freeze@1.5") == InjectedFault(
        "pose_source", kind="freeze", after_s=1.5
    )


@pytest.mark.parametrize(
    "text",
    [
        *("", "@", "@3", "explode", "kill now", "mute 3", "unmute@1+2", "kill@1+2"),
        *("motor 9", "motor -1", "motor x 1", "motor 1 2 3", "motor 1 nan", "motor 1 2.1"),
        *("pose_source", "pose_source break", "pose_source stop now", "camera", "estimate nan"),
        *("motor@", "motor@soon", "motor@-1", "motor@nan", "motor@1e3", "motor@86401"),
        *("mute@1+", "mute@1+0", "mute@1+3601", "mute@1+2+3", "mute@1..2", "mute@1@2"),
    ],
)
def test_unknown_faults_are_refused_with_the_known_ones(text: str) -> None:
    with pytest.raises(
        FaultTextError, match=r"is not a fault; there are kill, mute, .* camera stop"
    ):
        parse_fault(text)


def test_campaigns_have_the_same_kinds_and_limits() -> None:
    moment = {"on": "goal", "after_s": LATEST_S, "for_s": LONGEST_S}
    for kind in ("stop", "freeze"):
        text = f"pose_source {kind}@{LATEST_S:g}+{LONGEST_S:g}"
        assert parse_fault(text).kind == kind
        assert SignalFaultPart.model_validate({kind: moment}) is not None
    for name, value in (("after_s", LATEST_S + 1.0), ("for_s", LONGEST_S + 1.0)):
        with pytest.raises(ValueError, match="less than or equal"):
            SignalFaultPart.model_validate({"stop": {**moment, name: value}})
