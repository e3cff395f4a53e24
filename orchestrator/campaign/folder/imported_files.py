"""What a user's Python files import: their own modules, and installed packages."""

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

from orchestrator.campaign.folder.named_files import as_used

_MAX_FILES = 2000
_OURS = frozenset({"campaigns", "orchestrator", "recipes", "safety", "vehicles", "worlds"})
"""The packages of wil-campaign, which its version identifies."""


@dataclass(frozen=True, slots=True)
class Imported:
    """What Python files import. files: the user's own; packages: names of distributions."""

    files: frozenset[Path]
    packages: frozenset[str]


def imported_by(files: set[Path]) -> Imported:
    """Return what Python files import, directly and indirectly; no code is run.

    Only import statements are seen. A file that cannot be read or parsed imports nothing here: its
    loading reports the error.
    """
    installed = [Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "purelib")]
    known, packages, waiting = set(files), set[str](), list(files)
    while waiting and len(known) < _MAX_FILES:
        for module in _imported_modules(waiting.pop()):
            top = module.partition(".")[0]
            origin = None if top in _OURS else _origin(module)
            if origin is None:
                continue
            if any(origin.resolve().is_relative_to(folder) for folder in installed):
                packages.update(_distributions_of(top))
            elif origin not in known:
                known.add(origin)
                waiting.append(origin)
    return Imported(frozenset(known - files), frozenset(packages))


@cache
def _distributions_of(module: str) -> frozenset[str]:
    """Return the names of the installed distributions that provide a top-level module.

    Like importlib.metadata.packages_distributions(), which parses the metadata of all distributions
    and takes half a second.
    """
    if module in sys.stdlib_module_names:
        return frozenset()
    return frozenset(one.name for one in distributions() if _provides(one, module))


def _provides(distribution: Distribution, module: str) -> bool:
    """Return whether an installed distribution provides a top-level module."""
    declared = distribution.read_text("top_level.txt")
    if declared and declared.strip():
        return module in declared.split()
    files = distribution.read_text("RECORD") or "\n".join(map(str, distribution.files or ()))
    return re.search(rf"^{re.escape(module)}[/.]", files, re.MULTILINE) is not None


def _imported_modules(file: Path) -> Iterator[str]:
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
    """Return the file of a module without importing it or its parent packages."""
    search_path: list[str] | None = None
    spec: ModuleSpec | None = None
    name = ""
    for part in module.split("."):
        name = f"{name}.{part}" if name else part
        spec = PathFinder.find_spec(name, search_path)
        if spec is None:
            return None
        search_path = list(spec.submodule_search_locations or [])
    if spec is None or spec.origin is None or not spec.origin.endswith((".py", ".so")):
        return None
    return as_used(Path(spec.origin))
