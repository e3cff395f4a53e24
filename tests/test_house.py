"""The house: every package stands in the contract of import-linter, and the contract holds."""

import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
NOT_PACKAGES = {"tests", "bench", "docs"}


def tools() -> Any:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]


def packages() -> set[str]:
    found = {path.parent.name for path in ROOT.glob("*/__init__.py")}
    return found - NOT_PACKAGES


def test_every_package_stands_in_the_contract() -> None:
    contract, *inner = tools()["importlinter"]["contracts"]
    layers = [name.strip() for layer in contract["layers"] for name in layer.split("|")]
    assert sorted(layers) == sorted(packages())
    assert sorted(tools()["importlinter"]["root_packages"]) == sorted(packages())
    assert all(one["exhaustive"] and one["type"] == "layers" for one in inner)
    assert packages() <= {name for one in inner for name in one["containers"]}


def test_every_package_is_checked_built_and_typed() -> None:
    assert set(tools()["mypy"]["packages"]) == {*packages(), "tests"}
    built = tools()["hatch"]["build"]["targets"]["wheel"]["packages"]
    assert set(built) == packages()
    assert all((ROOT / name / "py.typed").is_file() for name in packages())


def test_every_folder_of_code_is_a_package() -> None:
    for name in packages():
        for module in (ROOT / name).rglob("*.py"):
            assert (module.parent / "__init__.py").is_file(), module


def test_imports_point_down() -> None:
    code = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    done = subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-c", code, "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
