"""Product code that only tests use goes or moves: each definition is reached from the product.

Roots are what runs when a module is imported, what a decorator with arguments registers, the
programs (`__main__`) and what users import. A definition is reached where one that is reached
names it; a string that names one (`module:name`, a forward reference) counts.
"""

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from itertools import chain
from pathlib import Path

from tests.test_house import ROOT, packages

Definition = tuple[str, str]
"""A module, and a name at its top level."""

PUBLIC = {
    "wil_campaign.api": "what users' files import",
    "wil_campaign.core_plugin": "the hooks of the core",
    "wil_campaign.hooks": "what other people's plugins import",
    "wil_campaign.campaigns.autonomies.avoid": "campaign files name it",
    "wil_campaign.campaigns.autonomies.detour": "campaign files name it",
    "wil_campaign.campaigns.autonomies.follow": "campaign files name it",
    "wil_campaign.campaigns.autonomies.gate": "campaign files name it",
    "wil_campaign.campaigns.autonomies.place": "campaign files name it",
    "wil_campaign.campaigns.autonomies.straight": "campaign files name it",
    "wil_campaign.plugins.pytest.pytest_plugin": "the entry point of pytest11",
    "wil_campaign.plugins.pytest.pytest_items": "the plugin imports it by name",
    "wil_campaign": "what users' programs import",
    "wil_campaign.orchestrator.cli": "the entry point wil-campaign",
    "wil_campaign.plugins.python.replay_source": "docs/recording.md: a live source",
}
"""Modules that something outside of the product's Python uses, and what."""
PLUGINS = "wil_campaign.plugins.{}.plugin"
"""The modules that are found by their folders."""
CALLED_FROM_OUTSIDE = {
    "connection_made": "asyncio calls it",
    "connection_lost": "asyncio calls it",
    "data_received": "asyncio calls it",
    "datagram_received": "asyncio calls it",
    "error_received": "asyncio calls it",
    "_run_once": "asyncio calls it",
    "path_stats": "importlib calls it",
    "_timer_handle_cancelled": "asyncio calls it",
    "authenticate": "amqtt calls it",
    "topic_filtering": "amqtt calls it",
    "runtest": "pytest calls it",
    "teardown": "pytest calls it",
    "reportinfo": "pytest calls it",
    "oracle_rows": "docs/python.md: programs of users call it",
    "run_folder": "docs/python.md: programs of users call it",
    "set_level": "JSBSim calls it",
    "file_location": "JSBSim calls it",
}
"""Attributes that a library uses."""
NO_REGISTRY = re.compile(
    r"(dataclass|contextlib|(async)?contextmanager|functools|cache|lru_cache|overload|njit|jit)\b"
)
"""Decorators that keep a definition from nothing: it must still be used."""
Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(slots=True)
class Uses:
    """What a piece of code names: plain names, `name.attribute`, all attributes, strings."""

    names: set[str] = field(default_factory=set)
    dotted: set[tuple[str, str]] = field(default_factory=set)
    attributes: set[str] = field(default_factory=set)
    texts: set[str] = field(default_factory=set)

    def read(self, tree: ast.AST) -> "Uses":
        for node in ast.walk(tree):
            if isinstance(node, ast.Name):
                if isinstance(node.ctx, ast.Load):
                    self.names.add(node.id)
            elif isinstance(node, ast.Attribute):
                self.attributes.add(node.attr)
                if isinstance(node.value, ast.Name):
                    self.dotted.add((node.value.id, node.attr))
            elif isinstance(node, ast.keyword):
                self.attributes.add(node.arg or "")
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                self.texts.add(node.value)
        return self


class Module:
    """What a module defines, imports, and does when it is imported."""

    def __init__(self, name: str, tree: ast.Module) -> None:
        self.name, self.tree = name, tree
        self.defined: dict[str, list[Uses]] = {}
        self.at_import = Uses()
        self.imported: dict[str, tuple[str, str | None]] = {}
        self.methods: set[str] = set()
        self._read(tree.body)

    @property
    def uses(self) -> Iterator[Uses]:
        yield self.at_import
        yield from chain.from_iterable(self.defined.values())

    def _read(self, body: list[ast.stmt]) -> None:
        for node in body:
            match node:
                case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                    self.defined.setdefault(node.name, []).append(Uses().read(node))
                    if any(registers(decorator) for decorator in node.decorator_list):
                        self.at_import.names.add(node.name)
                    self._read_inside(node)
                case ast.Assign() | ast.AnnAssign():
                    uses = Uses().read(node)
                    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                    for name in chain.from_iterable(map(ast.walk, targets)):
                        if isinstance(name, ast.Name):
                            self.defined.setdefault(name.id, []).append(uses)
                case ast.If():
                    self._read(node.body + node.orelse)
                case ast.Try():
                    self._read(node.body + node.orelse + node.finalbody)
                case ast.Import() | ast.ImportFrom():
                    self._read_import(node)
                case _:
                    self.at_import.read(node)

    def _read_inside(self, node: Function | ast.ClassDef) -> None:
        """Read the imports of functions, and the methods that no decorator registers."""
        for one in node.body:
            if isinstance(one, ast.Import | ast.ImportFrom):
                self._read_import(one)
            elif isinstance(one, Function | ast.ClassDef):
                if isinstance(node, ast.ClassDef) and not any(
                    isinstance(decorator, ast.Call) for decorator in one.decorator_list
                ):
                    self.methods.add(one.name)
                self._read_inside(one)

    def _read_import(self, node: ast.Import | ast.ImportFrom) -> None:
        for name in node.names:
            if isinstance(node, ast.Import):
                self.imported[name.asname or name.name] = (name.name, None)
            elif node.module:
                above = self.name.rsplit(".", node.level)[0] + "." if node.level else ""
                self.imported[name.asname or name.name] = (f"{above}{node.module}", name.name)


def registers(decorator: ast.expr) -> bool:
    return NO_REGISTRY.match(ast.unparse(decorator)) is None


class Reach:
    """Follows names from definition to definition."""

    def __init__(self, modules: Mapping[str, Module]) -> None:
        self._modules = modules
        self._loaded: set[str] = set()
        self._todo: list[Definition] = []
        self.reached: set[Definition] = set()

    def load(self, name: str, *, whole: bool = False) -> None:
        """Take that a module is imported; whole: all of it is used."""
        module = self._modules.get(name)
        if module is None:
            return
        if name not in self._loaded:
            self._loaded.add(name)
            self.load(name.rpartition(".")[0])
            self._follow(module, module.at_import)
            for source, part in module.imported.values():
                self.load(source)
                self.load(f"{source}.{part}")
        if whole:
            for each in (*module.defined, *module.imported):
                self._use(module, each)

    def run(self) -> None:
        while self._todo:
            name, part = self._todo.pop()
            self.load(name)
            for uses in self._modules[name].defined[part]:
                self._follow(self._modules[name], uses)

    def _follow(self, module: Module, uses: Uses) -> None:
        for name in uses.names:
            self._use(module, name)
        for name, part in uses.dotted:
            source, inner = module.imported.get(name, ("", None))
            for whole in (source, f"{source}.{inner}"):
                if whole in self._modules:
                    self._use(self._modules[whole], part)
        for text in uses.texts:
            self._follow_text(module, text)

    def _follow_text(self, module: Module, text: str) -> None:
        self.load(text, whole=True)
        for source, part in re.findall(r"([\w.]+):(\w+)", text):
            if source in self._modules:
                self._use(self._modules[source], part)
        if re.fullmatch(r"[A-Za-z_][\w\[\], |.]*", text):
            for name in re.findall(r"\w+", text):
                self._use(module, name)

    def _use(self, module: Module, name: str) -> None:
        while name not in module.defined:
            source, part = module.imported.get(name, ("", None))
            if source not in self._modules or part is None:
                return
            if (source, part) == (module.name, name):
                return
            module, name = self._modules[source], part
        if (found := (module.name, name)) not in self.reached:
            self.reached.add(found)
            self._todo.append(found)


@cache
def product() -> dict[str, Module]:
    paths = chain.from_iterable((ROOT / name).rglob("*.py") for name in packages())
    return {(name := module_name(path)): Module(name, parse(path)) for path in paths}


def module_name(path: Path) -> str:
    name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    return name if name.startswith("wil_campaign") else f"wil_campaign.{name}"


def parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def is_program(tree: ast.Module) -> bool:
    last = tree.body[-1] if tree.body else None
    return isinstance(last, ast.If) and "__main__" in ast.unparse(last.test)


def unreached(modules: Mapping[str, Module], public: Iterator[str]) -> set[Definition]:
    reach = Reach(modules)
    for name in public:
        reach.load(name, whole=True)
    for name, module in modules.items():
        if name.endswith("__main__") or is_program(module.tree):
            reach.load(name)
    reach.run()
    every = {(name, part) for name, module in modules.items() for part in module.defined}
    return {(name, part) for name, part in every - reach.reached if not part.startswith("__")}


def test_each_definition_is_reached_from_the_product() -> None:
    modules = product()
    assert set(modules) >= set(PUBLIC)
    plugins = [PLUGINS.format(path.parent.name) for path in ROOT.glob("plugins/*/plugin.py")]
    dead = unreached(modules, iter([*PUBLIC, *plugins]))
    assert not dead, "\n".join(f"{module}: {name}" for module, name in sorted(dead))


def unnamed_methods(modules: Mapping[str, Module]) -> set[str]:
    """The methods whose name stands nowhere else, not in a string either."""
    named, found = set[str](), set[str]()
    for module in modules.values():
        found |= module.methods
        for uses in module.uses:
            named |= uses.names | uses.attributes
            named.update(chain.from_iterable(re.findall(r"\w+", text) for text in uses.texts))
    return {name for name in found - named if not name.startswith("__")}


def test_each_method_is_named_somewhere_else() -> None:
    assert unnamed_methods(product()) <= set(CALLED_FROM_OUTSIDE)


def test_a_definition_that_only_dead_code_uses_is_found() -> None:
    sources = {
        "house.a": "from house.b import used\ndef main() -> None:\n    used()\n",
        "house.b": "LIMIT = 1\ndef used() -> int:\n    return LIMIT\n"
        "def dead() -> None:\n    inner()\ndef inner() -> None: ...\n"
        "class Kept:\n    def one(self) -> None: ...\nprint(Kept)",
    }
    modules = {name: Module(name, ast.parse(text)) for name, text in sources.items()}
    assert unreached(modules, iter(["house.a"])) == {("house.b", "dead"), ("house.b", "inner")}
    assert unnamed_methods(modules) == {"one"}
