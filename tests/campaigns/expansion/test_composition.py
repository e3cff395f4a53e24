"""Campaigns of campaigns: runs of the parts as their own files have them, under the part's name."""

from typing import Any

import pytest

from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, load_campaign
from wil_campaign.foundation.files.documents import BadInput

TEXT = """\
schema: wil/campaign/1
campaign: both
campaigns:
  one: campaign.yaml
  other: other.yaml
"""
CONTROL = """\
controls:
  blind: {set: {goal.altitude_m: 1.0}, expect: {oracle: reached}, modes: [sim]}
"""


@pytest.fixture
def both(files: Any) -> Any:
    """Return the files with a second campaign and one that names both."""
    text = files.path.read_text()
    other = text.replace("campaign: small", "campaign: second").replace("seed: 7", "seed: 8")
    (files.folder / "other.yaml").write_text(other + CONTROL)
    (files.folder / "both.yaml").write_text(TEXT)
    return files


def load(files: Any, more: str = "", **options: Any) -> Campaign:
    (files.folder / "both.yaml").write_text(TEXT + more)
    return load_campaign(files.folder / "both.yaml", ExpansionOptions(**options))


def faults(files: Any, more: str = "", **options: Any) -> list[str]:
    with pytest.raises(BadInput) as caught:
        load(files, more, **options)
    return [problem.headline.removeprefix(f"{files.folder}/") for problem in caught.value.problems]


def test_runs_are_those_of_the_parts_under_their_names(both: Any) -> None:
    whole, part = load(both), both.load()
    assert whole.name == "both"
    assert whole.cases == ("one.large", "one.small", "other.large", "other.small")
    assert len(whole.runs) == 2 * len(part.runs)
    for run, own in zip(whole.runs, part.runs, strict=False):
        assert (run.name, run.seed) == (f"one.{own.name}", own.seed)
        assert run.files.campaign.data == own.files.campaign.data
        assert run.required == own.required
    seeds = {(run.case.partition(".")[0], run.seed) for run in whole.runs}
    assert len({seed for _, seed in seeds}) == len(seeds)
    assert {str(requirement.share) for requirement in whole.requirements} == {"3/3", "2/3"}
    assert {requirement.case for requirement in whole.requirements} == {"one.large", "other.large"}
    assert set(whole.setups) >= set(whole.cases)
    assert both.folder / "other.yaml" in whole.paths


def test_modes_repetitions_and_seed_hold_for_every_part_and_options_are_stronger(both: Any) -> None:
    more = "modes: [sim]\nrepetitions: 2\nseed: 5\n"
    whole = load(both, more)
    assert {run.mode for run in whole.runs} == {"sim"}
    assert max(run.repetition for run in whole.runs) == 2
    assert whole.runs[0].seed == both.load(seed=5).runs[0].seed
    assert load(both, more, seed=6).runs[0].seed == both.load(seed=6).runs[0].seed
    assert len(load(both, more, repetitions=1).runs) == 4


def test_a_selection_goes_by_the_names_with_the_part_and_says_what_it_leaves_out(both: Any) -> None:
    whole = load(both, cases=("one.l*",))
    assert {run.case for run in whole.runs} == {"one.large"}
    assert "the campaign other" in whole.left_out
    (fault,) = faults(both, cases=("large",))
    assert "matches none of one.large, one.small" in fault


def test_controls_are_flown_or_named_as_left_out(both: Any) -> None:
    whole = load(both)
    (control,) = whole.controls
    assert (control.case, control.mode) == ("other.blind", "sim")
    assert control.control is not None
    assert control.control.case == "other.large"
    without = load(both, "fly_controls: false\n")
    assert without.controls == ()
    assert any("controls of other" in said for said in without.left_out)


def test_required_runs_of_a_composition_that_options_omit_are_named(both: Any) -> None:
    more = "repetitions: 10\n"
    assert load(both, more).left_out == ()
    assert load(both, more, repetitions=1).left_out == (
        "one: 9 of 10 repetitions",
        "other: 9 of 10 repetitions",
    )
    accept = "accept: {large: {sim: 3/3, wil: 2/3}}\n"
    other = both.folder / "other.yaml"
    other.write_text(other.read_text().replace(accept, ""))
    more = "modes: [sim, wil, real]\n"
    assert load(both, more).left_out == ()
    # The other part names what must pass, and real is not among it.
    assert load(both, more, modes=("sim", "wil")).left_out == (
        "other: large/real",
        "other: small/real",
    )


def test_runs_that_a_composition_omits_from_its_parts_are_named(both: Any) -> None:
    said = ("one: large/wil", "one: 1 of 3 repetitions")
    whole = load(both, "modes: [sim]\nrepetitions: 2\n")
    assert whole.left_out == (*said, "other: large/wil", "other: 1 of 3 repetitions")


def test_faults_stand_where_they_are(both: Any) -> None:
    assert "both.yaml:5:10: campaign file 'other.yaml' does not exist" in str(
        (both.folder / "other.yaml").unlink() or faults(both)
    )
    (both.folder / "other.yaml").write_text(TEXT)
    (fault,) = faults(both)
    assert "'other.yaml' is itself made of campaigns" in fault
    (both.folder / "other.yaml").write_text(both.path.read_text() + "nothing: 1\n")
    (fault,) = faults(both)
    assert fault.startswith("other.yaml:")
    (fault,) = faults(both, "vehicles: {}\n")
    assert fault.startswith("both.yaml:6:1")


def test_published_counts_are_of_cases_that_are_there(both: Any) -> None:
    load(both, "published: {passed: {one.large: {sim: 5/5}}}\n")
    (fault,) = faults(both, "published: {passed: {large: {sim: 5/5}}}\n")
    assert "published names an unknown case 'large'" in fault


@pytest.mark.parametrize(
    ("more", "key"),
    [
        ("between_runs: fly_back\n", "between_runs"),
        (
            "operator: {mqtt: {broker: 'mqtt://127.0.0.1:1883'}, on_operator_loss: abort}\n",
            "operator.mqtt",
        ),
    ],
)
def test_a_key_that_a_composition_has_once_must_be_equal_in_its_parts(
    both: Any, more: str, key: str
) -> None:
    other = both.folder / "other.yaml"
    other.write_text(other.read_text() + more)
    (fault,) = faults(both)
    assert fault.startswith("both.yaml:5:10: ")
    assert f"'other' and 'one' differ in {key}, which all parts of a composition share" in fault
    # Where one part flies alone there is nothing to share.
    assert load(both, cases=("one.*",)).cases
    one = both.folder / "campaign.yaml"
    one.write_text(one.read_text() + more)
    assert load(both).cases


def test_two_parts_may_not_come_to_one_name(both: Any) -> None:
    """Their results would share a folder: of two runs one was counted, or one counted twice."""
    for name, case in (("campaign.yaml", "small: {}\n  b.x"), ("other.yaml", "x")):
        path = both.folder / name
        path.write_text(path.read_text().replace("  small: ", f"  {case}: "))
    (both.folder / "both.yaml").write_text(TEXT.replace("one:", "a:").replace("other:", "a.b:"))
    with pytest.raises(BadInput) as caught:
        load_campaign(both.folder / "both.yaml")
    (problem,) = caught.value.problems
    assert "both.yaml:5:3: 'a.b' and 'a' both have 'a.b.x'; rename a part" in problem.headline


def test_parts_with_different_sequential_tests_need_repetitions_of_the_composition(
    both: Any,
) -> None:
    other = both.folder / "other.yaml"
    text = other.read_text()
    decided = "repetitions: {until: decided, at_least: 0.95, against: 0.5, most: 20}"
    assert "repetitions: 3" in text
    text = (
        text.replace("repetitions: 3", decided).replace("3/3", "decided").replace("2/3", "decided")
    )
    other.write_text(text)
    (fault,) = faults(both)
    assert "'other' and 'one' differ in the sequential test of repetitions" in fault
