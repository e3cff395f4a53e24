"""What a user's Python files import: their own modules, and installed packages."""

import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import Distribution, distributions
from importlib.util import find_spec
from pathlib import Path

from wil_campaign.foundation.files.user_modules import user_file_path, user_files
from wil_campaign.orchestrator.campaign.folder.named_files import path_as_used

_MAX_FILES = 2000
_OURS = "wil_campaign"
"""This program, which its version identifies."""


@dataclass(frozen=True, slots=True)
class ImportedFiles:
    """What Python files import. files: the user's own; packages: names of distributions."""

    files: frozenset[Path]
    packages: frozenset[str]


def files_imported_by(files: set[Path]) -> ImportedFiles:
    """Return what Python files import, directly and indirectly.

    This is what they have imported where this process, or the check of the autonomy, has run them,
    however they found it; and what their import statements mean, which may be executed in flight.
    A file that cannot be read or parsed imports nothing here: its loading reports the error.
    """
    run = {path for file in files for path in user_files(file.resolve().parent) if path.exists()}
    known, packages, waiting = files | run, set[str](), [(file, file) for file in files | run]
    named = {file.resolve() for file in files}
    while waiting and len(known) < _MAX_FILES:
        file, named_file = waiting.pop()
        for module in _imported_modules(file):
            top = module.lstrip(".").partition(".")[0]
            origin = None if top == _OURS else _origin(module, file, named_file)
            if origin is None:
                continue
            if user_file_path(str(origin)) is None:
                packages.update(_distributions_of(top))
            elif origin not in known:
                known.add(origin)
                waiting.append((origin, named_file))
    return ImportedFiles(
        frozenset(one for one in known if one.resolve() not in named), frozenset(packages)
    )


@cache
def _distributions_of(module: str) -> frozenset[str]:
    """Return the names of the installed distributions that provide a top-level module.

    Like importlib.metadata.packages_distributions(), which parses the metadata of all distributions
    and takes half a second.
    """
    if module in sys.stdlib_module_names:
        return frozenset()
    return frozenset(
        distribution.name for distribution in distributions() if _provides(distribution, module)
    )


def _provides(distribution: Distribution, module: str) -> bool:
    """Return whether an installed distribution provides a top-level module."""
    declared = distribution.read_text("top_level.txt")
    if declared and declared.strip():
        return module in declared.split()
    files = distribution.read_text("RECORD") or "\n".join(map(str, distribution.files or ()))
    return re.search(rf"^{re.escape(module)}[/.]", files, re.MULTILINE) is not None


def _imported_modules(file: Path) -> Iterator[str]:
    """Yield the names of modules that a file's import statements may mean, relative with dots."""
    if file.suffix != ".py":
        return
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            joint = "." if node.module else ""
            if node.module:
                yield base
            yield from (f"{base}{joint}{alias.name}" for alias in node.names)


def _origin(module: str, file: Path, named: Path) -> Path | None:
    """Return the file of a module without importing it or its parent packages.

    file: which imports it. named: the file that the campaign names, beside which modules are found
    first.
    """
    name = module.lstrip(".")
    level = len(module) - len(name)
    if level:
        return _found_in(name, [str(file.parents[level - 1])])
    beside = _found_in(name, [str(named.parent)])
    if beside is not None:
        return beside
    top, _, rest = name.partition(".")
    try:
        spec = find_spec(top)
    except (ImportError, ValueError):
        return None
    if spec is None or not rest:
        return _file_of(spec)
    return _found_in(rest, list(spec.submodule_search_locations or []))


def _found_in(name: str, search_path: list[str]) -> Path | None:
    """Return the file of a module beneath folders."""
    spec: ModuleSpec | None = None
    for part in name.split("."):
        spec = PathFinder.find_spec(part, search_path)
        if spec is None:
            return None
        search_path = list(spec.submodule_search_locations or [])
    return _file_of(spec)


def _file_of(spec: ModuleSpec | None) -> Path | None:
    """Return the file of a module; None for one that is built in, or a package without code."""
    if spec is None or spec.origin is None or not spec.origin.endswith((".py", ".so")):
        return None
    return path_as_used(Path(spec.origin))
