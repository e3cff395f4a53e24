"""No task of ours is started where nobody sees how it ends."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = (
    "bench",
    "campaigns",
    "orchestrator",
    "plugins",
    "recipes",
    "safety",
    "vehicles",
    "worlds",
)
HELPER = ROOT / "vehicles" / "tasks.py"
_STARTS = {"create_task", "ensure_future"}
_GROUPS = {"group", "tasks"}
"""What a TaskGroup is called; its tasks it awaits itself."""


def bare_starts(source: str) -> Iterator[str]:
    """Give the calls in a source that start a task without a group, or without a name."""
    if not any(name in source for name in _STARTS):
        return
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute | ast.Name):
            continue
        called = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
        if called not in _STARTS:
            continue
        owner = node.func.value if isinstance(node.func, ast.Attribute) else None
        of_group = isinstance(owner, ast.Name) and owner.id in _GROUPS
        named = any(word.arg == "name" for word in node.keywords)
        if not (called == "create_task" and of_group and named):
            yield f"line {node.lineno}: {ast.unparse(node)}"


def test_tasks_are_started_by_groups_with_a_name_or_by_the_helper() -> None:
    found = {
        str(path.relative_to(ROOT)): calls
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if path != HELPER and (calls := list(bare_starts(path.read_text("utf-8"))))
    }
    assert found == {}


def has_except_star(source: str) -> bool:
    """Return whether a source catches parts of a group of errors by `except*`."""
    if "except*" not in source:
        return False
    return any(isinstance(node, ast.TryStar) for node in ast.walk(ast.parse(source)))


def test_except_star_is_not_used() -> None:
    """What it raises arrives in a group on Debian 12: `raising_first_of` stands for it."""
    found = [
        str(path.relative_to(ROOT))
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if has_except_star(path.read_text("utf-8"))
    ]
    assert found == []
    assert has_except_star("try:\n    run()\nexcept* OSError:\n    raise\n")


def test_a_bare_start_is_found() -> None:
    assert list(bare_starts("asyncio.create_task(run(), name='x')"))
    assert list(bare_starts("asyncio.ensure_future(run())"))
    assert list(bare_starts("group.create_task(run())"))
    assert not list(bare_starts("group.create_task(run(), name='x')"))
