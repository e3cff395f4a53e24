"""`wil-campaign plan`: the runs of a campaign, and what they can show."""

import json

import pytest

from tests.orchestrator.cli.commands.test_cli_commands import ROOT, Cli


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Cli:
    monkeypatch.chdir(ROOT)
    return Cli(capsys)


def test_plan_shows_a_table(cli: Cli) -> None:
    outcome = cli("plan", "campaigns/gate.yaml", "--case", "large", "--mode", "sim")
    assert outcome.code == 0
    lines = outcome.out.splitlines()
    assert lines[0].startswith("gate: 5 runs; accepted: large/sim 5/5")
    assert lines[2].split() == ["case", "mode", "rep", "seed", "counts"]
    assert lines[4].split() == ["large", "sim", "1", "3820083363037036", "required"]
    assert len(lines) == 11
    assert "all passed, show a pass rate of at least 0.54" in lines[10]
    assert "0.80 needs 14, 0.90 needs 29, 0.95 needs 59, 0.99 needs 299" in lines[10]


def test_plan_as_json_has_the_test_that_decides(cli: Cli) -> None:
    """It said that all of the most flights must pass."""
    until = "repetitions={until: decided, at_least: 0.95, against: 0.8, most: 60}"
    given = ("--case", "large", "--mode", "sim", "--set", until, "--set", "accept=null")
    outcome = cli("plan", "campaigns/gate.yaml", *given, "--json")
    assert outcome.code == 0, outcome.err
    decided = {"at_least": 0.95, "against": 0.8, "most": 60, "error": 0.05}
    accept = json.loads(outcome.out)["accept"]
    assert accept == [{"case": "large", "mode": "sim", "test": decided}]


def test_plan_claims_no_more_than_the_flights_show(cli: Cli) -> None:
    """Of 58 flights it said 0.95, and in the same line that 0.95 needs 59; of 600, 1.00."""
    given = ("plan", "campaigns/gate.yaml", "--case", "large", "--mode", "sim", "--repetitions")
    for count, shown in ((1, "0.05"), (28, "0.89"), (58, "0.94"), (59, "0.95"), (600, "0.99")):
        assert f"a pass rate of at least {shown} with" in cli(*given, str(count)).out


def test_plan_as_json_is_one_document(cli: Cli) -> None:
    given = ("--case", "small", "--case", "large", "--repetitions", "1", "--seed", "4", "--json")
    outcome = cli("plan", "campaigns/gate.yaml", *given, "--set", "goal.altitude_m=1.3")
    assert outcome.code == 0
    document = json.loads(outcome.out)
    assert [(run["case"], run["mode"], run["rep"]) for run in document["runs"]] == [
        ("large", "sim", 1),
        ("large", "wil", 1),
        ("small", "sim", 1),
        ("small", "wil", 1),
    ]
    assert document["seed"] == 4
    assert document["accept"][0] == {"case": "large", "mode": "sim", "passes": 1, "runs": 1}


def test_plan_of_a_bad_file_or_option_is_reported(cli: Cli) -> None:
    assert cli("plan", "none.yaml").code == 2
    outcome = cli("plan", "campaigns/gate.yaml", "--case", "lagre", "--json")
    assert (outcome.code, outcome.out) == (2, "")
    assert "did you mean 'large'?" in outcome.err
