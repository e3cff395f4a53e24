"""`faults` of a campaign: signals that stop or freeze on purpose, and what is refused."""

from typing import Any

import pytest

from wil_campaign.campaigns.values.signal_faults import SignalFault

FAULTS = """\
faults:
  real:
    pose_source: {stop: {on: goal, after_s: 1}}
    sensors: {camera: {freeze: {on: at_height, for_s: 2}}}
"""


def test_faults_are_read_and_each_result_says_them(files: Any) -> None:
    files.append(FAULTS)
    campaign = files.load()
    assert campaign.runs[0].setup().faults == (
        SignalFault(vehicle="real", sensor=None, kind="stop", stage="goal", after_s=1.0),
        SignalFault(vehicle="real", sensor="camera", kind="freeze", stage="at_height", for_s=2.0),
    )
    assert campaign.caveats == (
        "fault injected: the pose source of real stops 1 s after stage goal",
        (
            "fault injected: the autonomy's sensor camera of real freezes 0 s after stage "
            "at_height for 2 s"
        ),
    )


def test_a_control_stops_a_signal_and_no_run_does(files: Any) -> None:
    files.append(
        "controls:\n"
        "  silent:\n"
        "    set: {faults.real.pose_source: {stop: {on: goal}}}\n"
        "    expect: {verdict: INVALID, cause: pose of real}\n"
    )
    campaign = files.load()
    assert campaign.caveats == ()
    assert [len(plan.setup().faults) for plan in campaign.runs] == [0] * len(campaign.runs)
    assert [len(plan.setup().faults) for plan in campaign.controls] == [1, 1]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("{camera: {freeze", "{camra: {freeze", "no sensor 'camra'; did you mean 'camera'?"),
        ("stop: {on: goal, after_s: 1}", "", "give stop, or freeze"),
        ("{on: goal, after_s: 1}", "{on: gaol}", "gaol"),
        ("pose_source:", "pose_sorce:", "did you mean 'pose_source'?"),
        ("after_s: 1", "after_s: -1", "0"),
    ],
)
def test_a_wrong_entry_of_a_fault_is_reported(files: Any, old: str, new: str, said: str) -> None:
    assert FAULTS.count(old) == 1
    files.append(FAULTS.replace(old, new))
    assert any(said in fault for fault in files.faults()), files.faults()
