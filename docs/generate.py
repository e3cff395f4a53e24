"""Writes what docs/ shows of the code itself: the layers in architecture.md, and api.md.

`python docs/generate.py` writes both; tests/test_docs.py says when a page is stale.
"""

import ast
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
            rows = [row.rstrip() for row in package_rows(name, found)]
            parts += [f"**{name}**", "", "```text", *rows, "```", ""]
    return "\n".join(parts)


def architecture(text: str) -> str:
    """Return architecture.md with the layers as the contracts are now."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{layers_block()}\n{END}{after}"


def main() -> None:
    """Write both pages."""
    ARCHITECTURE.write_text(architecture(ARCHITECTURE.read_text("utf-8")), "utf-8")


if __name__ == "__main__":
    main()
