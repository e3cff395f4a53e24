"""Controls in a campaign file: what they change, and what is refused."""

from typing import Any

import pytest

CONTROLS = """\
controls:
  blind:
    set: {autonomy: {use: straight, with: {speed_m_s: 1.5}}}
    expect: {oracle: reached}
  empty:
    case: small
    modes: [wil]
    set: {recipe.combine.0.filter: [{isolate_color: {name: blue}}]}
    expect: {verdict: INVALID, cause: nothing}
"""


def with_controls(files: Any, text: str = CONTROLS) -> None:
    files.append(text)


def test_a_control_is_flown_once_in_each_of_its_modes_after_the_runs(files: Any) -> None:
    with_controls(files)
    campaign = files.load()
    assert [plan.name for plan in campaign.controls] == [
        "blind/sim/1",
        "blind/wil/1",
        "empty/wil/1",
    ]
    assert [plan.name for plan in campaign.plans[-3:]] == [p.name for p in campaign.controls]
    assert len(campaign.runs) == 12
    assert all(plan.control is None for plan in campaign.runs)
    assert not any(plan.required for plan in campaign.controls)


def test_a_control_differs_from_its_case_by_its_settings_alone(files: Any) -> None:
    with_controls(files)
    campaign = files.load()
    seeds = {plan.name: plan.seed for plan in campaign.plans}
    assert seeds["blind/wil/1"] == seeds["large/wil/1"]
    assert seeds["empty/wil/1"] == seeds["small/wil/1"]
    setups = {plan.name: plan.setup() for plan in campaign.plans}
    assert setups["blind/wil/1"].under_test.use == "straight"
    assert setups["empty/wil/1"].under_test.use == "pilot.py:Pilot"
    gates = {name: setup.world.scene("sim", "Wv")["gate"].shape for name, setup in setups.items()}
    limits = {name: shape.openings[0].limit_m for name, shape in gates.items()}
    assert limits["empty/wil/1"] == limits["small/wil/1"] != limits["large/wil/1"]


def test_a_setting_of_a_control_wins_over_the_command_line(files: Any) -> None:
    with_controls(files)
    campaign = files.load(sets=("autonomy.with.speed_m_s=0.3",))
    speeds = {p.name: p.setup().under_test.parameters["speed_m_s"] for p in campaign.plans}
    assert speeds["blind/sim/1"] == 1.5
    assert speeds["large/sim/1"] == speeds["empty/wil/1"] == 0.3


def test_controls_that_the_command_line_leaves_out_are_reported(files: Any) -> None:
    with_controls(files)
    assert files.load().left_out == ()
    large = files.load(cases=("large",))
    assert large.controls == ()
    assert [text for text in large.left_out if "control" in text] == [
        "the control blind/sim",
        "the control blind/wil",
        "the control empty/wil",
    ]
    blind = files.load(cases=("blind",), modes=("wil",))
    assert [plan.name for plan in blind.plans] == ["blind/wil/1"]
    assert "the control blind/sim" in blind.left_out
    assert "the control blind/wil" not in blind.left_out


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("expect: {oracle: reached}", "expect: {}", "name the oracle that must fail, or a text of"),
        ("{oracle: reached}", "{oracle: reachd}", "no oracle 'reachd' judges this control"),
        (
            "{oracle: reached}",
            "{verdict: ERROR, oracle: reached}",
            "an oracle fails with FAIL, not",
        ),
        ("{oracle: reached}", "{verdict: PASS, oracle: reached}", "must be FAIL, INVALID or ERROR"),
        ("  blind:\n", "  large:\n", "'large' is also a case"),
        ("case: small", "case: smal", "there is no case 'smal'; did you mean 'small'?"),
        ("modes: [wil]", "modes: [real]", "mode 'real' is not flown"),
        (
            "set: {recipe.combine.0.filter: [{isolate_color: {name: blue}}]}",
            "set: {}",
            "at least 1",
        ),
        ("recipe.combine.0.filter: [{isolate_color: {name: blue}}]", "seed: 3", "is the same for"),
        ("with: {speed_m_s: 1.5}", "with: {sped_m_s: 1.5}", "unknown parameter 'sped_m_s'"),
    ],
)
def test_a_wrong_control_is_reported_with_its_line(
    files: Any, old: str, new: str, said: str
) -> None:
    assert CONTROLS.count(old) == 1
    with_controls(files, CONTROLS.replace(old, new))
    assert any(said in fault for fault in files.faults()), files.faults()


def test_collision_always_is_switched_off_by_its_own_key_alone(files: Any) -> None:
    assert files.load().runs[0].setup().collision_always
    files.append("collision_always: off\n")
    assert not files.load().runs[0].setup().collision_always


def test_a_cause_names_the_pose_source_that_its_vehicle_has(files: Any) -> None:
    said = 'cause: "pose of {name} from {{{name}.pose_source}}"'
    controls = "controls:\n" + "".join(
        f"  {name}:\n    set: {{faults.{name}.pose_source: {{stop: {{on: goal}}}}}}\n"
        f"    modes: [wil]\n    expect: {{verdict: INVALID, {said.format(name=name)}}}\n"
        for name in ("real", "twin")
    )
    with_controls(files, controls)

    def causes(*sets: str) -> list[str | None]:
        plans = files.load(sets=sets).controls
        return [plan.control.cause for plan in plans if plan.control is not None]

    assert causes() == ["pose of real from mocap", "pose of twin from mavlink"]
    assert causes("vehicles.real.pose_source=simulator") == [
        "pose of real from simulator",
        "pose of twin from mavlink",
    ]
    files.change("large: {}", "large: {vehicles.twin.pose_source: simulator}")
    assert causes()[1] == "pose of twin from simulator"
