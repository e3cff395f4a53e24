"""Builds the pages that the code states: docs/api.md and docs/lists.md.

api.md, what files of users import, is made from the docstrings; the modules are read, not imported,
so that the page is the same on every Python. lists.md is what `wil-campaign list` and the help of
each command print. It is a hook of mkdocs.yml too: the site has these pages, and names files of the
repository that are no pages. A clone has neither page, so that no committed page links to them:
pages name the command that prints the same (`wil-campaign list oracles`), which the site links.
"""

import ast
import contextlib
import inspect
import io
import os
import re
from collections.abc import Iterator
from pathlib import Path

from wil_campaign.orchestrator.cli import all_commands
from wil_campaign.orchestrator.cli import main as run_command

ROOT = Path(__file__).parents[1]
API = ROOT / "docs" / "api.md"

INTRODUCTION = """# What your own files import
Autonomies, steps of recipes and detectors of your own import `wil_campaign.api` and nothing else of
this program: its names stay when modules move. Programs beside the campaign
([delivery](delivery.md)) import nothing; they speak MAVLink and read environment variables.
Scripts that fly campaigns and read recordings import `wil_campaign` ([how](python.md)).

This page is made from the docstrings by `python docs/generate.py`.
"""
USERS = "wil_campaign.api"
PROGRAMS = "wil_campaign"
TITLES: dict[str, tuple[str, ...]] = {
    "An autonomy": ("wil_campaign.vehicles.autonomy", "wil_campaign.vehicles.setpoints"),
    "Readings": ("wil_campaign.vehicles.readings", "wil_campaign.worlds.camera"),
    "A step of a recipe": ("wil_campaign.recipes",),
    "A sensor type": ("wil_campaign.vehicles.sensors",),
    "An oracle": ("wil_campaign.safety.oracles",),
    "Detectors": ("wil_campaign.vehicles.perception", "wil_campaign.plugins.detector"),
    "Poses and frames": ("wil_campaign.worlds.frames", "wil_campaign.vehicles.poses"),
}
"""Titles of api.md, each with the modules or packages from which wil_campaign.api has its names."""
LISTS_HEAD = """# Lists that the program prints
This page is made by `python docs/generate.py`, which runs the commands.
"""
OF_RECORDINGS = "Recording Recorded RecordedReading RecordedProvenance RecordedEvent"


def sections() -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Yield the sections of api.md: title, module to import from, names in the module's order.

    Raises LookupError for a name that no title of TITLES takes.
    """
    imports = [one for one in ast.walk(module_tree(USERS)) if isinstance(one, ast.ImportFrom)]
    left = {
        alias.name: str(one.module)
        for one in imports
        for alias in one.names
        if str(one.module).startswith("wil_campaign.")
    }
    for title, sources in TITLES.items():
        here = [
            name
            for source in sources
            for name, module in left.items()
            if f"{module}.".startswith(f"{source}.")
        ]
        yield title, USERS, tuple(here)
        left = {name: module for name, module in left.items() if name not in here}
    if left:
        raise LookupError(f"no title of TITLES takes {left}")
    yield "Recordings", PROGRAMS, tuple(OF_RECORDINGS.split())


def module_tree(module: str) -> ast.Module:
    """Return a module's syntax."""
    path = ROOT / module.replace(".", "/")
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return ast.parse(path.read_text("utf-8"))


def definition(module: str, name: str) -> tuple[ast.stmt, str]:
    """Return where a name is defined, followed through imports, and the text that explains it."""
    body = [
        inner
        for node in module_tree(module).body
        for inner in (node.body if isinstance(node, ast.If) else [node])
    ]
    for node, after in zip(body, [*body[1:], None], strict=True):
        match node:
            case ast.ImportFrom(module=str(source), names=names) if any(
                one.name == name for one in names
            ):
                return definition(source, name)
            case ast.ClassDef() | ast.FunctionDef() if node.name == name:
                return node, ast.get_docstring(node) or ""
            case (
                ast.Assign(targets=[ast.Name(id=target)])
                | ast.AnnAssign(target=ast.Name(id=target))
            ) if target == name:
                return node, stated(after)
    raise LookupError(f"{module} has no {name}")


def stated(node: ast.stmt | None) -> str:
    """Return the text that stands below an assignment."""
    match node:
        case ast.Expr(value=ast.Constant(value=str(text))):
            return inspect.cleandoc(text)
    return ""


def signature(function: ast.FunctionDef) -> str:
    """Return a function as it is called, without self."""
    arguments = function.args
    kept = [one for one in arguments.args if one.arg not in {"self", "cls"}]
    plain = ast.arguments(
        posonlyargs=[],
        args=kept,
        vararg=arguments.vararg,
        kwonlyargs=arguments.kwonlyargs,
        kw_defaults=arguments.kw_defaults,
        kwarg=arguments.kwarg,
        defaults=arguments.defaults,
    )
    returns = "" if function.returns is None else f" -> {ast.unparse(function.returns)}"
    return f"({ast.unparse(plain)}){returns}"


def members(kind: ast.ClassDef) -> Iterator[str]:
    """Return a class's fields and public methods as lines of a list."""
    for node in kind.body:
        match node:
            case ast.AnnAssign(target=ast.Name(id=name)) if not name.startswith("_"):
                default = "" if node.value is None else f" = {ast.unparse(node.value)}"
                yield f"- `{name}: {ast.unparse(node.annotation)}{default}`"
            case ast.FunctionDef(name=name) if not name.startswith("_") or name == "__call__":
                decorators = {ast.unparse(one) for one in node.decorator_list}
                called = signature(node)
                if "property" in decorators:
                    called = called.removeprefix("()")
                text = " ".join((ast.get_docstring(node) or "").split())
                yield f"- `{name}{called}`: {text}".rstrip(": ")


def entry(module: str, name: str) -> str:
    """Return the part of api.md on one name."""
    node, text = definition(module, name)
    lines: list[str] = []
    match node:
        case ast.ClassDef():
            functions = [one for one in node.body if isinstance(one, ast.FunctionDef)]
            made = next((function for function in functions if function.name == "__init__"), None)
            called = "" if made is None else signature(made).removesuffix(" -> None")
            head = f"class {name}{called}"
            lines = list(members(node))
        case ast.FunctionDef():
            head = f"{name}{signature(node)}"
        case ast.AnnAssign():
            head = f"{name}: {ast.unparse(node.annotation)}"
        case ast.Assign():
            head, lines = name, [f"`{ast.unparse(node.value)}`"]
        case _:
            head = name
    listed = "\n".join(lines)
    return "\n\n".join(part for part in (f"### `{head}`", text, listed) if part) + "\n"


def api() -> str:
    """Return api.md."""
    parts = [INTRODUCTION]
    for title, module, names in sections():
        parts.append(f"## {title}\n`from {module} import ...`\n")
        parts += [entry(module, name) for name in names]
    return "\n".join(parts)


LISTS = ROOT / "docs" / "lists.md"
LISTED = {
    "oracles": "Oracles, and the keys of each",
    "signals": "Signals of formulas",
    "operators": "Steps of recipes, and the parameters of each",
    "autonomies": "Autonomies that come with the program",
}
LIMITS = "wil_campaign.foundation.files.limits"


def slug(title: str) -> str:
    """Return a heading's anchor, as MkDocs and GitHub make it."""
    return re.sub(r"[^\w\- ]", "", title.casefold()).replace(" ", "-")


def limits() -> str:
    """Return the limits of files as a table."""
    rows = [
        f"| `{node.targets[0].id}` | {eval(ast.unparse(node.value)):,} | {_joined(stated(after))} |"  # noqa: S307 - numbers of ours
        for node, after in zip(module_tree(LIMITS).body, module_tree(LIMITS).body[1:], strict=False)
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
    ]
    return "\n".join(["| limit | value | of |", "|---|---|---|", *rows])


def lists() -> str:
    """Return lists.md, as the commands print it."""
    parts = [LISTS_HEAD]
    for word, title in LISTED.items():
        parts.append(f"## {title}\n`wil-campaign list {word}`\n\n{_printed('list', word)}")
    parts.append(f"## Limits of files\n{limits()}\n")
    parts.append("## Options of every command")
    names = sorted(all_commands())
    parts += [f"### {name}\n{_printed(*name.split(), '--help')}" for name in names]
    return "\n".join(parts)


def _printed(*arguments: str) -> str:
    """Return what a command prints, as a block of code."""
    os.environ["COLUMNS"] = "100"
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown):
        run_command(list(arguments))
    return f"```text\n{shown.getvalue().rstrip()}\n```\n"


def _joined(text: str) -> str:
    return " ".join(text.split())


def main() -> None:
    """Write the pages."""
    API.write_text(api(), "utf-8")
    LISTS.write_text(lists(), "utf-8")


def on_pre_build(**_: object) -> None:
    """Build the page before mkdocs looks for it."""
    main()


PRINTED = {
    **{f"`wil-campaign list {word}`": f"lists.md#{slug(title)}" for word, title in LISTED.items()},
    "`wil-campaign list`": "lists.md",
    "`wil-campaign COMMAND --help`": "lists.md#options-of-every-command",
    "`wil_campaign.api`": "api.md",
    "`wil_campaign/api.py`": "api.md",
    "`wil_campaign/foundation/files/limits.py`": "lists.md#limits-of-files",
}
"""What pages name for the generated pages, and where the site has it."""


def on_page_markdown(markdown: str, page: object, **_: object) -> str:
    """Return a page's text as the site shows it.

    A link to a file outside of docs/ is that file's name; what prints or has the text of a
    generated page is a link to that page.
    """
    here = str(page.file.src_uri)  # type: ignore[attr-defined]
    depth = here.count("/")
    shown = re.sub(rf"\[[^]]+\]\((?:\.\./){{{depth + 1}}}([^)#]+)[^)]*\)", r"`\1`", markdown)
    if depth or here in {"api.md", "lists.md"}:
        return shown
    parts = re.split(r"(?ms)(^```.*?^```$|\[[^]]*\]\([^)]*\))", shown)
    return "".join(part if number % 2 else _linked(part) for number, part in enumerate(parts))


def _linked(text: str) -> str:
    """Return text in which each name of PRINTED is a link."""
    names = "|".join(map(re.escape, PRINTED))
    return re.sub(names, lambda found: f"[{found[0]}]({PRINTED[found[0]]})", text)


if __name__ == "__main__":
    main()
