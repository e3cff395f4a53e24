"""What a user's Python file imports: its files, and the packages that it needs."""

import ast
import re
import sys
import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import Distribution, distributions
from pathlib import Path

_MOST_FILES = 2000
_OURS = frozenset({"campaigns", "orchestrator", "recipes", "safety", "vehicles", "worlds"})
"""Our own packages: the version of wil-campaign stands for them."""


@dataclass(frozen=True, slots=True)
class Imported:
    """What Python files import. files: the user's own; packages: distributions, by name."""

    files: frozenset[Path]
    packages: frozenset[str]


def imported_by(files: set[Path]) -> Imported:
    """Return what Python files import, and what these import; nothing of it is run.

    Imports that are made by other means than statements are not seen. A file that cannot be read
    or parsed imports nothing here: whoever loads it reports that.
    """
    installed = [Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "purelib")]
    found, packages, waiting = set(files), set[str](), list(files)
    while waiting and len(found) < _MOST_FILES:
        for module in _modules(waiting.pop()):
            top = module.partition(".")[0]
            origin = None if top in _OURS else _origin(module)
            if origin is None:
                continue
            if any(origin.is_relative_to(folder) for folder in installed):
                packages.update(_distributions_of(top))
            elif origin not in found:
                found.add(origin)
                waiting.append(origin)
    return Imported(frozenset(found - files), frozenset(packages))


@cache
def _distributions_of(module: str) -> frozenset[str]:
    """Return the names of the installed distributions that bring a top-level module.

    As importlib.metadata.packages_distributions(), which parses what all of them bring and say of
    themselves: that takes half a second.
    """
    if module in sys.stdlib_module_names:
        return frozenset()
    return frozenset(one.name for one in distributions() if _brings(one, module))


def _brings(distribution: Distribution, module: str) -> bool:
    """Return whether an installed distribution brings a top-level module."""
    declared = distribution.read_text("top_level.txt")
    if declared and declared.strip():
        return module in declared.split()
    files = distribution.read_text("RECORD") or "\n".join(map(str, distribution.files or ()))
    return re.search(rf"^{re.escape(module)}[/.]", files, re.MULTILINE) is not None


def _modules(file: Path) -> Iterator[str]:
    """Yield the absolute names of modules that a file's import statements may mean."""
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _origin(module: str) -> Path | None:
    """Return the file of a module without importing it or the packages around it."""
    places: list[str] | None = None
    spec: ModuleSpec | None = None
    name = ""
    for part in module.split("."):
        name = f"{name}.{part}" if name else part
        spec = PathFinder.find_spec(name, places)
        if spec is None:
            return None
        places = list(spec.submodule_search_locations or [])
    if spec is None or spec.origin is None or not spec.origin.endswith((".py", ".so")):
        return None
    return Path(spec.origin).resolve()
