"""Children are started by `ChildProcess`, but in the places that decision 44 gives reasons for."""

import ast
import re
from pathlib import Path

import pytest

_ROOT = Path(__file__).parents[4]
_PACKAGES = ["campaigns", "orchestrator", "plugins", "recipes", "safety", "vehicles", "worlds"]
_PACKAGES += ["wil_campaign/foundation"]
_CLASS = "wil_campaign/foundation/processes/child.py"
_DECISION = _ROOT / "docs" / "decisions" / "0044-children-without-a-loop.md"


def raw_children(source: str) -> list[ast.Call]:
    """Return the calls in a source that start a child and do not wait for its end."""
    names = {"Popen", "create_subprocess_exec", "create_subprocess_shell"}
    if not any(name in source for name in names):
        return []
    calls = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]
    return [call for call in calls if ast.unparse(call.func).rpartition(".")[2] in names]


@pytest.mark.parametrize(
    "source",
    [
        "subprocess.Popen(['a'])",
        "with Popen(['a']) as process: pass",
        "async def f(): await asyncio.create_subprocess_exec('a')",
    ],
)
def test_a_raw_child_is_found(source: str) -> None:
    assert len(raw_children(source)) == 1


def test_the_decision_names_every_place_that_starts_a_raw_child() -> None:
    places: dict[str, list[ast.Call]] = {}
    for package in _PACKAGES:
        for file in (_ROOT / package).rglob("*.py"):
            if calls := raw_children(file.read_text(encoding="utf-8")):
                places[file.relative_to(_ROOT).as_posix()] = calls
    del places[_CLASS]
    rows = re.findall(r"^\| (\S+\.py) \|", _DECISION.read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(places) == sorted(rows)
    for place, calls in places.items():
        for call in calls:
            sessions = [keyword for keyword in call.keywords if keyword.arg == "start_new_session"]
            assert [ast.unparse(session.value) for session in sessions] == ["True"], place
