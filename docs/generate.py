"""Writes what docs/ shows of the code itself: the layers in architecture.md, and api.md.

`python docs/generate.py` writes both; tests/test_docs.py says when a page is stale. Modules are
read, not imported, so that the pages are the same on every Python.
"""

import ast
import inspect
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
ARCHITECTURE = ROOT / "docs" / "architecture.md"
API = ROOT / "docs" / "api.md"
BEGIN, END = "<!-- layers: begin -->\n", "<!-- layers: end -->\n"

Contracts = dict[str, list[list[str]]]
"""By package: its layers from top to bottom, each the modules that stand beside each other."""


def contracts() -> Contracts:
    """Return the contracts of import-linter; the key of the top-level one is ""."""
    tool = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]
    found: Contracts = {}
    for contract in tool["contracts"]:
        layers = [[name.strip(" ()") for name in one.split("|")] for one in contract["layers"]]
        for container in contract.get("containers", [""]):
            found[container] = layers
    return found


def first_line(module: str) -> str:
    """Return the first line of a module's docstring; "" for a module that is not there yet."""
    path = ROOT / module.replace(".", "/")
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    if not path.is_file():
        return ""
    text = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
    return text.partition("\n")[0]


def house(found: Contracts) -> str:
    """Return the top-level packages as boxes: each may import those below it."""
    width = 44
    rule = "+" + "-" * width + "+"
    boxes = [f"|{'   |   '.join(layer):^{width}}|" for layer in found[""]]
    return "\n".join([rule, *(line for box in boxes for line in (box, rule))])


def package_rows(package: str, found: Contracts, indent: int = 0) -> Iterator[str]:
    """Return the layers of a package as lines, the top one first, then those inside of them."""
    rule = ""
    for layer in found[package]:
        there = [(name, says) for name in layer if (says := first_line(f"{package}.{name}"))]
        if there and rule:
            yield rule
        for name, says in there:
            yield f"{' ' * indent}{name:<{28 - indent}} {says}"
            if f"{package}.{name}" in found:
                yield from package_rows(f"{package}.{name}", found, indent + 4)
        rule = " " * indent + "-" * (28 - indent) if there else rule


def layers_block() -> str:
    """Return the part of architecture.md that is made from the contracts."""
    found = contracts()
    parts = ["```text", house(found), "```", ""]
    for layer in found[""]:
        for name in layer:
            if name not in found:
                parts += [f"**{name}**", "", first_line(name), ""]
                continue
            rows = [row.rstrip() for row in package_rows(name, found)]
            parts += [f"**{name}**", "", "```text", *rows, "```", ""]
    return "\n".join(parts)


def architecture(text: str) -> str:
    """Return architecture.md with the layers as the contracts are now."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{layers_block()}\n{END}{after}"


INTRODUCTION = """# What your own files import
Autonomies, steps of recipes and detectors of your own import `campaigns.api` and nothing else of
this program: its names stay when modules move. Programs beside the campaign
([delivery](delivery.md)) import nothing; they speak MAVLink and read environment variables. Scripts
that read recordings import `orchestrator.recording.mcap_reader`.

This page is made from the docstrings by `python docs/generate.py`.
"""
USERS = "campaigns.api"
RECORDINGS = "orchestrator.recording.mcap_reader"
TITLES: dict[str, tuple[str, ...]] = {
    "An autonomy": ("vehicles.autonomy", "vehicles.setpoints"),
    "Readings": ("vehicles.readings", "worlds.camera"),
    "A step of a recipe": ("recipes",),
    "Detectors": ("vehicles.perception",),
    "Poses and frames": ("worlds.frames", "vehicles.poses"),
}
"""Titles of api.md, each with the modules or packages from which campaigns.api has its names."""
OF_RECORDINGS = "Recording Recorded RecordedReading RecordedProvenance RecordedEvent"


def sections() -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Yield the sections of api.md: title, module to import from, names in the module's order.

    Raises LookupError for a name that no title of TITLES takes.
    """
    imports = [one for one in module_tree(USERS).body if isinstance(one, ast.ImportFrom)]
    left = {alias.name: str(one.module) for one in imports for alias in one.names}
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
    yield "Recordings", RECORDINGS, tuple(OF_RECORDINGS.split())


def module_tree(module: str) -> ast.Module:
    """Return a module's syntax."""
    path = ROOT / module.replace(".", "/")
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return ast.parse(path.read_text("utf-8"))


def definition(module: str, name: str) -> tuple[ast.stmt, str]:
    """Return where a name is defined, followed through imports, and the text that explains it."""
    body = module_tree(module).body
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
            made = next((one for one in functions if one.name == "__init__"), None)
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


def main() -> None:
    """Write both pages."""
    ARCHITECTURE.write_text(architecture(ARCHITECTURE.read_text("utf-8")), "utf-8")
    API.write_text(api(), "utf-8")


if __name__ == "__main__":
    main()
