"""The table of wheels: what pip is asked, and what its answers become."""

from collections.abc import Sequence

import pytest

from bench.wheels import SYSTEMS, cell, main, requirements


def test_a_cell_names_all_that_have_no_wheel() -> None:
    asked: list[Sequence[str]] = []

    def ask(command: Sequence[str]) -> tuple[int, str]:
        asked.append(command)
        for name in ("python_fcl", "jsbsim"):
            if any(one.lower().startswith(name.replace("_", "-")) for one in command):
                return 1, f"ERROR: No matching distribution found for {name}>=1\n"
        return 0, ""

    wanted = ["numpy>=2", "python-fcl>=1", "JSBSim>=1"]
    assert cell("3.14", "Linux arm64", wanted, ["--no-index"], ask) == "not python-fcl, jsbsim"
    assert len(asked) == 3
    assert "--no-index" in asked[0]
    assert asked[0][asked[0].index("--python-version") + 1] == "3.14"
    assert "manylinux_2_28_aarch64" in asked[0]
    assert asked[-1][-1] == "numpy>=2"


def test_an_error_of_another_kind_is_shown_and_not_asked_again() -> None:
    count = 0

    def ask(_: Sequence[str]) -> tuple[int, str]:
        nonlocal count
        count += 1
        return 1, "WARNING: x\nERROR: no network\n"

    assert cell("3.11", "Windows x86-64", ["numpy"], [], ask) == "not ERROR: no network"
    assert count == 1


def test_the_table_has_a_row_for_each_python(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--python", "3.11,3.12", "--extras", "logs"], ask=lambda _: (0, "")) == 0
    lines = capsys.readouterr().out.splitlines()
    cells = " | ".join(["all"] * len(SYSTEMS))
    assert lines[2:] == [f"| {one} | {cells} |" for one in ("3.11", "3.12")]
    assert main(["--python", "3.11"], ask=lambda _: (1, "")) == 1


def test_dependencies_are_those_of_the_project() -> None:
    assert any(requirement.startswith("pymavlink") for requirement in requirements([]))
    assert any(requirement.startswith("pyulog") for requirement in requirements(["logs"]))
