"""Warnings for what users' files import of this program beside its public modules."""

import ast
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import wil_campaign
from wil_campaign import api
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.foundation.files.problems import Problem
from wil_campaign.foundation.files.user_modules import user_files

_PUBLIC = {module.__name__: frozenset(module.__all__) for module in (api, wil_campaign)}


def import_warnings(files: CaseFiles, case: Case) -> Iterator[Problem]:
    """Yield a warning for each import of an internal module by the user's code of a case.

    Its files are those that this process, or its check of the autonomy, has loaded.
    """
    folders = set[Path]()
    if case.under_test.code_folder is not None:
        folders.add(case.under_test.code_folder)
    if files.recipe is not None and case.recipe is not None:
        names = [reference.rpartition(":")[0] for reference in case.recipe.references()]
        folders.update((files.recipe.path.parent / name).resolve().parent for name in names)
    for file in sorted({file for folder in folders for file in user_files(folder)}):
        yield from _internal_imports(file)


def _internal_imports(file: Path) -> tuple[Problem, ...]:
    """Return the warnings for a file of the user's.

    A file that cannot be parsed has none: its loading reports the error.
    """
    here = Path.cwd()
    shown = str(file.relative_to(here) if file.is_relative_to(here) else file)
    try:
        return _imports_of(shown, file.read_text("utf-8"))
    except (OSError, SyntaxError, ValueError):
        return ()


@lru_cache(maxsize=256)
def _imports_of(shown: str, text: str) -> tuple[Problem, ...]:
    """Return the warnings for a file's text, which the cases of a campaign share."""
    return tuple(_find_imports(shown, text))


def _find_imports(shown: str, text: str) -> Iterator[Problem]:
    """Yield the warnings for a file's text. Raises SyntaxError, ValueError."""
    tree = ast.parse(text)
    lines = text.splitlines()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom) and (message := _message(node)):
            line = lines[node.lineno - 1]
            yield Problem(shown, node.lineno, node.col_offset + 1, message, line)


def _message(node: ast.Import | ast.ImportFrom) -> str:
    """Return what is internal of an import statement, with the remedy; "" for nothing."""
    if isinstance(node, ast.Import):
        internal = [one.name for one in node.names if _is_internal(one.name)]
        return _text(internal[0], "") if internal else ""
    module = node.module or ""
    names = [one.name for one in node.names]
    if node.level or (module in _PUBLIC and _PUBLIC[module].issuperset(names)):
        return ""
    if module == "wil_campaign":
        internal = [name for name in names if name not in {"api", *_PUBLIC[module]}]
        return _text(f"{module}.{internal[0]}", "") if internal else ""
    if not _is_internal(module):
        return ""
    public = [
        f"from {place} import {', '.join(found)}"
        for place, known in _PUBLIC.items()
        if (found := [name for name in names if name in known])
    ]
    return _text(module, "; ".join(public))


def _is_internal(module: str) -> bool:
    return module.startswith("wil_campaign.") and module not in _PUBLIC


def _text(module: str, public: str) -> str:
    remedy = public or "`python -m pydoc wil_campaign.api` shows what is public"
    return f"'{module}' is internal to wil-campaign and may change with any version: {remedy}"
