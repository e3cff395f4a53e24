"""Cases x modes x repetitions: which runs, with which seeds, files and requirements."""

import pickle
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from wil_campaign import campaigns
from wil_campaign.campaigns.expansion.expansion import Campaign, RunPlan, load_campaign
from wil_campaign.campaigns.values.acceptance import PassRequirement, PassShare
from wil_campaign.foundation.files import yaml_nodes
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.orchestrator.campaign.folder.manifest import (
    campaign_manifest,
    maybe_written_files,
)
from wil_campaign.plugins.hints import magnitude_warnings

SHIPPED = sorted(Path(campaigns.__file__).parent.glob("*.yaml"))


def names(campaign: Campaign) -> list[str]:
    return [run.name for run in campaign.runs]


def inner_size_m(run: RunPlan) -> float:
    (opening,) = run.setup().world.scene("sim", "Wv")["gate"].shape.openings
    return 2.0 * opening.limit_m


def test_runs_are_ordered_by_case_mode_and_repetition(files: Any) -> None:
    campaign = files.load()
    assert names(campaign) == [
        f"{case}/{mode}/{rep}"
        for case in ("large", "small")
        for mode in ("sim", "wil")
        for rep in (1, 2, 3)
    ]
    assert campaign.name == "small"
    assert [path.name for path in campaign.paths] == ["campaign.yaml", "world.yaml", "recipe.yaml"]


def test_a_case_overrides_the_world_and_no_other_case(files: Any) -> None:
    runs = {run.case: run for run in files.load().runs}
    assert inner_size_m(runs["large"]) == pytest.approx(1.0)
    assert inner_size_m(runs["small"]) == pytest.approx(0.5)


def values_read(files: Any, cases: int) -> int:
    """Return how many values of files are read to check a campaign of so many cases."""
    listed = "".join(f"  c{index}: {{goal.altitude_m: 1.5}}\n" for index in range(cases))
    path = files.folder / "campaign.yaml"
    head, _, rest = path.read_text().partition("  large: {}\n")
    path.write_text(f"{head}  large: {{}}\n{listed}{rest}")
    read = mock.Mock(wraps=yaml_nodes.plain_value_of_node)
    angles = mock.Mock(wraps=magnitude_warnings._degrees_as_radians)
    with (
        mock.patch.object(yaml_nodes, "plain_value_of_node", read),
        mock.patch.object(magnitude_warnings, "_degrees_as_radians", angles),
    ):
        campaign = files.load()
        campaign_manifest(campaign, "virtual")
        maybe_written_files(campaign)
    path.write_text(f"{head}  large: {{}}\n{rest}")
    assert len(campaign.cases) == cases + 2
    return int(read.call_count + angles.call_count)


def test_a_case_is_checked_without_the_others(files: Any) -> None:
    few, some, many = (values_read(files, count) for count in (1, 3, 5))
    assert many - some == some - few


def test_a_case_overrides_campaign_recipe_and_file(files: Any) -> None:
    (files.folder / "other.yaml").write_text((files.folder / "world.yaml").read_text())
    files.change("inner_size_m: 1.0", "inner_size_m: 0.7", "other.yaml")
    files.change(
        "  large: {}",
        "  large: {goal.altitude_m: 1.5, recipe.combine.0.max_skew_ms: 20, world: other.yaml}",
    )
    run = files.load().runs[0]
    setup = run.setup()
    assert setup.goal.altitude_m == 1.5
    assert setup.recipe.combinations[0].max_skew_s == pytest.approx(0.02)
    assert inner_size_m(run) == pytest.approx(0.7)


XML = """\
<recipe_file>
  <AS_sensors><Camera id="camera" rate_hz="15"/></AS_sensors>
  <combine id="camera" max_skew_ms="60">
    <transform> register.py </transform>
    <filter> color_isolation.py </filter>
    <merge> prioritize_overlay.py </merge>
  </combine>
</recipe_file>
"""


def test_the_recipe_may_be_the_papers_xml_and_overridden_like_any_other(files: Any) -> None:
    (files.folder / "recipe.xml").write_text(XML)
    files.change("recipe: recipe.yaml", "recipe: recipe.xml")
    files.change("  large: {}", "  large: {recipe.combine.0.max_skew_ms: 20}")
    runs = {run.case: run.setup().recipe.combinations[0] for run in files.load().runs}
    assert [step.kind.name for step in runs["small"].steps] == ["register", "isolate_color"]
    assert runs["large"].max_skew_s == pytest.approx(0.02)
    assert runs["small"].max_skew_s == pytest.approx(0.06)
    files.change("color_isolation", "colour_isolation", "recipe.xml")
    with pytest.raises(BadInput, match=r"recipe\.xml:5:14: there is no file") as caught:
        files.load()
    assert "did you mean 'color_isolation.py'?" in str(caught.value)


def test_set_is_stronger_than_a_case(files: Any) -> None:
    key = "world.objects.gate.shape.gate.inner_size_m"
    campaign = files.load(sets=(f"{key}=0.8", "goal.altitude_m=1.1"))
    assert all(inner_size_m(run) == pytest.approx(0.8) for run in campaign.runs)
    assert {run.setup().goal.altitude_m for run in campaign.runs} == {1.1}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"sets": ("altitude",)}, "--set altitude: must be KEY=VALUE"),
        ({"sets": ("=5",)}, "--set =5: must be KEY=VALUE"),
        ({"sets": ("goal..x=5",)}, "--set goal..x=5: must be KEY=VALUE"),
        ({"sets": ("goal.altitude_m=[",)}, "--set goal.altitude_m=[: not YAML"),
        (
            {"sets": ("gaol.altitude_m=1",)},
            "--set gaol.altitude_m=1: override 'gaol.altitude_m': there is no 'gaol'; did you",
        ),
        ({"sets": ("goal.altitud_m=1",)}, "--set goal.altitud_m=1: unknown key 'altitud_m'; did"),
        ({"sets": ("goal.altitude_m=high",)}, "--set goal.altitude_m=high: must be a number"),
        ({"sets": ("world.orign=1",)}, "--set world.orign=1: unknown key 'orign'; did you mean"),
        ({"seed": -1}, "--seed -1: must be at least 0, is -1"),
        ({"repetitions": 0}, "--repetitions 0: must be at least 1, is 0"),
        ({"cases": ("lagre",)}, "--case lagre: matches none of large, small; did you mean 'large'"),
        ({"modes": ("real",)}, "--mode real: matches none of sim, wil"),
    ],
)
def test_impossible_options_are_reported(files: Any, options: Any, said: str) -> None:
    found = files.faults(**options)
    assert len(found) == 1, found
    assert found[0].startswith(said)


def test_options_select_cases_and_modes(files: Any) -> None:
    campaign = files.load(cases=("sm*",), modes=("wil",))
    assert names(campaign) == ["small/wil/1", "small/wil/2", "small/wil/3"]
    assert campaign.requirements == ()
    assert not any(run.required for run in campaign.runs)
    assert names(files.load(cases=("small", "large"), modes=("wil", "sim"), repetitions=1)) == [
        "large/sim/1",
        "large/wil/1",
        "small/sim/1",
        "small/wil/1",
    ]


def test_a_version_is_required_of_a_vehicle_that_flies(files: Any) -> None:
    whole = "large: {sim: 3/3, wil: 2/3}"
    files.change(whole, f'{whole}, firmware: {{real: "1.16", twin: "4.6"}}')
    assert files.load().left_out == ()
    fewer = (f'accept={{{whole}, firmware: {{twin: "4.6"}}}}',)
    assert files.load(sets=fewer).left_out == ("firmware 1.16 of real",)
    placed = ("vehicles.twin.coupling=placed", "modes=[wil]", "accept.large={wil: 2/3}")
    with pytest.raises(BadInput, match="no mode flies 'twin': its version is never checked"):
        files.load(sets=placed)


def test_required_runs_that_options_omit_are_reported(files: Any) -> None:
    assert files.load().left_out == ()
    assert files.load(cases=("large",), repetitions=6).left_out == ()
    assert files.load(modes=("sim",)).left_out == ("large/wil",)
    assert files.load(sets=("description=x",)).left_out == ()
    narrower = ("modes=[sim]", "accept={large: {sim: 3/3}}")
    assert files.load(sets=narrower).left_out == ("large/wil",)
    softer = ("accept={large: {sim: 2/3, wil: 3/3}}",)
    assert files.load(sets=softer).left_out == ("large/sim 3/3 (only 2/3)",)
    judged = ("oracles={landed: {}, reached: {}}",)
    assert "the oracle collision" in files.load(sets=judged).left_out
    assert files.load(cases=("small",), repetitions=1).left_out == (
        "large/sim",
        "large/wil",
        "2 of 3 repetitions",
    )


def test_a_command_line_setting_is_named_with_the_value_of_the_file(files: Any) -> None:
    """A limit may be among it: a PASS by that is no PASS of the file."""
    sets = ("oracles.time_limit.limit_s=500", "world.objects.gate.pose.north_m=2", "retries=3")
    assert files.load(sets=sets).caveats == (
        "set by the command line: oracles.time_limit.limit_s=500 (the file says 40)",
        "set by the command line: world.objects.gate.pose.north_m=2",
        "set by the command line: retries=3",
    )
    assert files.load(repetitions=1, seed=3).caveats == ()
    files.change("campaign: small\n", f"campaign: small\ndescription: {'page ' * 80}\n")
    (caveat,) = files.load(sets=("description=short",)).caveats
    assert caveat.endswith(" page p...)")
    assert len(caveat) < 200


def test_a_file_that_needs_an_option_is_compared_with_the_flown_one(files: Any) -> None:
    files.change("world: world.yaml\n", "")
    world = "world=world.yaml"
    assert files.load(sets=(world,)).left_out == ()
    assert files.load(sets=(world,), repetitions=1).left_out == ("2 of 3 repetitions",)
    files.change("modes: [sim, wil]\n", "")
    given = (world, "modes=[sim, wil]", "oracles={reached: {}}")
    fewer = ("the oracle collision", "the oracle time_limit", "the oracle geofence")
    assert files.load(sets=given).left_out == fewer


def test_a_selection_does_not_change_the_seeds(files: Any) -> None:
    seeds = {run.name: run.seed for run in files.load().runs}
    for run in files.load(cases=("small",), repetitions=2).runs:
        assert run.seed == seeds[run.name]


def test_modes_are_paired_and_all_else_differs(files: Any) -> None:
    runs = files.load().runs
    seeds: dict[tuple[str, int], set[int]] = {}
    for run in runs:
        seeds.setdefault((run.case, run.repetition), set()).add(run.seed)
    assert all(len(of_modes) == 1 for of_modes in seeds.values())
    assert len({seed for of_modes in seeds.values() for seed in of_modes}) == 6
    assert {run.seed for run in files.load(seed=8).runs}.isdisjoint({run.seed for run in runs})


def test_everything_is_required_without_accept(files: Any) -> None:
    files.change("accept: {large: {sim: 3/3, wil: 2/3}}\n", "")
    campaign = files.load()
    assert all(run.required for run in campaign.runs)
    assert {requirement.share for requirement in campaign.requirements} == {PassShare(3, 3)}


def test_accept_says_which_runs_are_required(files: Any) -> None:
    campaign = files.load()
    assert {run.case for run in campaign.runs if run.required} == {"large"}
    assert campaign.requirements == (
        PassRequirement("large", "sim", PassShare(3, 3)),
        PassRequirement("large", "wil", PassShare(2, 3)),
    )


def test_a_share_is_scaled_to_other_repetitions(files: Any) -> None:
    shares = {n: files.load(repetitions=n).requirements[1].share for n in (1, 3, 6, 10)}
    assert shares == {
        1: PassShare(1, 1),
        3: PassShare(2, 3),
        6: PassShare(4, 6),
        10: PassShare(7, 10),
    }
    assert files.load(sets=("repetitions=6",)).requirements[1].share == PassShare(4, 6)


def test_a_campaign_without_cases_has_one_case(files: Any) -> None:
    text = files.path.read_text()
    start, end = text.index("cases:"), text.index("modes:")
    text = text[:start] + text[end:]
    files.path.write_text(text.replace("accept: {large:", "accept: {default:"))
    assert {run.case for run in files.load().runs} == {"default"}


def test_runs_go_to_worker_processes(files: Any) -> None:
    run = files.load().runs[-1]
    (files.folder / "world.yaml").write_text("spoilt after the start: [")
    again = pickle.loads(pickle.dumps(run))  # noqa: S301 - our own bytes
    assert again == run
    assert inner_size_m(again) == pytest.approx(0.5)


def test_the_setup_has_the_values_of_the_file(files: Any) -> None:
    setup = files.load().runs[0].setup()
    real, twin = setup.vehicles["real"], setup.vehicles["twin"]
    assert (real.autopilot, real.profile, real.pose_source) == ("px4", "cage", "mocap")
    assert (twin.autopilot, twin.profile, twin.pose_source) == ("ardupilot", "nominal", "mavlink")
    (camera,) = real.cameras
    assert (camera.intrinsics.width_px, camera.rate_hz) == (320, 15.0)
    assert [use.name for use in setup.oracles] == ["collision", "reached", "time_limit", "geofence"]
    assert setup.fences["twin"].margin_m((0.0, 0.0, 0.0)) == pytest.approx(0.5)


def test_the_autonomy_gets_the_goal_but_not_where_the_gates_are(files: Any) -> None:
    under_test = files.load().runs[0].setup().under_test
    assert under_test.build(seed=1).goal == {"altitude_m": 1.2, "gate_count": 1}
    assert under_test.parameters == {"speed_m_s": 0.8}


def test_an_autonomy_of_ours_goes_by_its_name(files: Any) -> None:
    files.change("use: pilot.py:Pilot", "use: gate")
    assert type(files.load().runs[0].setup().under_test.build(seed=1)).__name__ == "GateAutonomy"


def test_an_oracle_may_be_used_twice_by_different_names(files: Any) -> None:
    files.change("  collision: {}", "  near: {use: clearance, min_m: 0.1}\n  collision: {}")
    uses = files.load().runs[0].setup().oracles
    assert [(use.name, use.kind) for use in uses[:2]] == [
        ("near", "clearance"),
        ("collision", "collision"),
    ]


def test_a_pose_source_is_as_exact_as_its_kind_or_as_given(files: Any) -> None:
    def accuracies() -> list[float]:
        setup = files.load().runs[0].setup()
        return [vehicle.pose_accuracy.position_m for vehicle in setup.vehicles.values()]

    kinds = [vehicle.pose_source for vehicle in files.load().runs[0].setup().vehicles.values()]
    usual = {"mocap": 0.002, "mavlink": 1.0}
    assert accuracies() == [usual[kind] for kind in kinds]
    said = "profile: cage\n    pose_accuracy: {position_m: 0.03, attitude_deg: 1}"
    files.change("profile: cage", said)
    assert accuracies() == [0.03, 1.0]


@pytest.mark.parametrize(("given", "used"), [("", 0.1), (", velocity_m_s: 0.4", 0.4)])
def test_an_estimate_whose_accuracy_is_given_is_still_held_to_its_own_velocity(
    files: Any, given: str, used: float
) -> None:
    files.change("pose_source: mocap", "pose_source: mavlink")
    said = f"profile: cage\n    pose_accuracy: {{position_m: 0.03, attitude_deg: 1{given}}}"
    files.change("profile: cage", said)
    real = files.load().runs[-1].setup().vehicles["real"]
    assert (real.pose_source, real.pose_accuracy.position_m) == ("mavlink", 0.03)
    assert real.pose_accuracy.velocity_m_s == used


def test_motion_capture_has_no_velocity_to_be_exact(files: Any) -> None:
    said = "pose_accuracy: {position_m: 0.03, attitude_deg: 1, velocity_m_s: 1}"
    files.change("profile: cage", f"profile: cage\n    {said}")
    with pytest.raises(BadInput, match="motion capture has positions only"):
        files.load()


def test_a_camera_may_be_given_by_its_focal_length(files: Any) -> None:
    text = files.path.read_text()
    mount = "mount: {forward_m: 0.1, down_m: -0.02, pitch_deg: -10}, stabilized: true"
    files.path.write_text(text.replace("fov_deg: 69", f"fx_px: 300, cy_px: 100, {mount}", 1))
    steps = "    transform: [{camera_model: real}]\n    filter:"
    files.change("    filter:", steps, file="recipe.yaml")
    (camera,) = files.load().runs[0].setup().vehicles["real"].cameras
    intrinsics = camera.intrinsics
    assert (intrinsics.fx_px, intrinsics.fy_px) == (300, 300)
    assert (intrinsics.cx_px, intrinsics.cy_px) == (159.5, 100)
    assert camera.mount.stabilized
    assert camera.mount.pose.position_ned_m == (0.1, 0.0, -0.02)
    forward = camera.mount.pose.to_parent((1.0, 0.0, 0.0))
    assert forward[2] > -0.02  # it looks down


def test_a_fence_may_have_circles_and_holes(files: Any) -> None:
    box = "box: {north_m: [-1, 4], east_m: [-2, 2], up_m: [-0.5, 2.3]}"
    circle = "include: [{circle: {north_m: 2, east_m: 0, radius_m: 2.5}}]"
    hole = "exclude: [{polygon: [[1, 1], [1, 2], [2, 2]]}]"
    files.change(box, f"{circle}\n  {hole}\n  up_m: [-0.5, 2.3]")
    fence = files.load().runs[0].setup().fences["real"]
    assert fence.margin_m((0.0, 0.0, -1.0)) == pytest.approx(0.5)
    assert fence.margin_m((1.2, 1.6, -1.0)) < 0


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_campaigns_are_good(path: Path) -> None:
    campaign = load_campaign(path)
    assert campaign.runs
    assert campaign.description


PERSON = """\
  person:
    shape: person
    pose: {north_m: 2, east_m: 2}
    motion:
      speed_sd_m_s: 0.2
      waypoints: [{north_m: 3, east_m: 2, speed_m_s: 1.4}]
"""


def speed_m_s(run: RunPlan) -> float:
    motion = run.setup().world.scene("sim", "Wv")["person"].motion
    assert motion is not None
    return motion.waypoints[0].speed_m_s


def test_a_drawn_speed_is_that_of_the_repetition_in_every_mode(files: Any) -> None:
    files.append(PERSON, "world.yaml")
    runs = [run for run in files.load().runs if run.case == "large"]
    speeds = {(run.mode, run.repetition): speed_m_s(run) for run in runs}
    of_sim = [speeds["sim", repetition] for repetition in (1, 2, 3)]
    assert of_sim == [speeds["wil", repetition] for repetition in (1, 2, 3)]
    assert len(set(of_sim)) == 3
    assert all(run.files.world.get(("seed",)) == run.seed for run in runs)


def test_a_world_that_draws_nothing_or_has_a_seed_is_as_its_file(files: Any) -> None:
    assert all(run.files.world.get(("seed",)) is None for run in files.load().runs)
    files.append(PERSON, "world.yaml")
    files.append("seed: 5\n", "world.yaml")
    assert len({speed_m_s(run) for run in files.load().runs}) == 1
