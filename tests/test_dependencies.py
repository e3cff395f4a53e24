"""What is imported is declared, what is declared is used, and the syntax is that of Python 3.11."""

import ast
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

HERE = Path(__file__).parents[1]
PACKAGES = ("wil_campaign", "orchestrator", "vehicles", "recipes", "campaigns", "safety", "worlds")
OLDEST = (3, 11)
NOT_IMPORTED = {"charset-normalizer", "pillow", "pycollada"}
"""What trimesh reads meshes with."""
OF_AN_EXTRA = {
    "amqtt",
    "cmaes",
    "covertable",
    "foxglove-sdk",
    "fsspec",
    "mcap-ros2-support",
    "optuna",
    "pytest",
    "ray",
}
OF_AN_EXAMPLE = {"mujoco"}
"""What vehicles/sources/mujoco_simulator.py draws with: an example, which is copied."""


def sources(*folders: str) -> Iterator[Path]:
    for folder in folders:
        yield from (HERE / folder).rglob("*.py")


def imported(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.split(".")[0]


def normal(name: str) -> str:
    return name.lower().replace("_", "-").replace(".", "-")


def declared() -> set[str]:
    with (HERE / "pyproject.toml").open("rb") as stream:
        lines: list[str] = tomllib.load(stream)["project"]["dependencies"]
    names = (line.split(";")[0] for line in lines)
    return {normal(name.split(">")[0].split("<")[0].split("=")[0].strip()) for name in names}


def test_imports_and_declarations_agree() -> None:
    ours = {*PACKAGES, *sys.stdlib_module_names}
    modules = {
        name for path in sources(*PACKAGES) for name in imported(ast.parse(path.read_text()))
    }
    brought_by = packages_distributions()
    used = {normal(name) for module in modules - ours for name in brought_by.get(module, [module])}
    assert used - OF_AN_EXTRA - OF_AN_EXAMPLE == declared() - NOT_IMPORTED


def test_what_is_slow_to_import_is_imported_only_where_it_is_needed() -> None:
    """Every process of every run pays for what stands at the top of a module: SciPy half a second.

    Calibration and statistics begin with it; no process that flies imports them.
    """
    tops = {
        str(path.relative_to(HERE))
        for path in sources(*PACKAGES)
        if "scipy" in (source := path.read_text())
        for node in ast.parse(source).body
        if isinstance(node, ast.Import | ast.ImportFrom) and "scipy" in imported(node)
    }
    statistics = {f"campaigns/statistics/{name}.py" for name in ("bootstrap", "proportions")}
    assert tops <= {"vehicles/calibration/mounting.py", *statistics}


@pytest.mark.parametrize("folder", [*PACKAGES, "tests", "bench"])
def test_the_syntax_is_that_of_the_oldest_python(folder: str) -> None:
    for path in sources(folder):
        ast.parse(path.read_text(), filename=str(path), feature_version=OLDEST)


def test_a_newer_syntax_would_be_seen() -> None:
    with pytest.raises(SyntaxError):
        ast.parse("type Name = int", feature_version=OLDEST)
