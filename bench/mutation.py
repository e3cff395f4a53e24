"""Put faults into the code, one at a time, and see whether a test finds each.

    python bench/mutation.py safety/oracles safety/guard --tests tests/safety --sample 40 --seed 1

Each mutant is one change of one expression or statement in a copy of the tree: a comparison that is
strict where it was not, a condition that is negated, a constant that is another, a sum that is a
difference, `and` for `or`, a statement that is gone, a result that is None. The tests run on it
until the first one fails. A mutant that no test finds is a survivor, printed with its line before
and after; the last line is the share that was found. `--list` prints the mutants and runs nothing.
"""

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
COPIED = ("campaigns", "orchestrator", "recipes", "safety", "tests", "vehicles", "worlds", "docs")
SINGLE = ("pyproject.toml", "README.md", "constraints.txt", "CHANGELOG.md")
COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
}


@dataclass(frozen=True)
class Mutant:
    """One change of a file. source: the whole file with the change."""

    file: Path
    line: int
    before: str
    after: str
    source: str

    def __str__(self) -> str:
        return f"{self.file.relative_to(ROOT)}:{self.line}: {self.before}  ->  {self.after}"


def _changed_nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield changed copies of a node, each with one change; none for a node that has no other."""
    match node:
        case ast.Compare(ops=[operator]) if type(operator) in COMPARISONS:
            changed = copy.deepcopy(node)
            changed.ops = [COMPARISONS[type(operator)]()]
            yield changed
        case ast.BinOp(op=operator) if type(operator) in OPERATORS:
            other = copy.deepcopy(node)
            other.op = OPERATORS[type(operator)]()
            yield other
        case ast.BoolOp(op=operator):
            swapped = copy.deepcopy(node)
            swapped.op = ast.Or() if isinstance(operator, ast.And) else ast.And()
            yield swapped
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield copy.deepcopy(operand)
        case ast.Constant(value=bool() as value):
            yield ast.Constant(value=not value)
        case ast.Constant(value=int() | float() as number):
            yield ast.Constant(value=number + 1)
        case ast.If(test=test) | ast.While(test=test):
            negated = copy.deepcopy(node)
            negated.test = ast.UnaryOp(op=ast.Not(), operand=copy.deepcopy(test))
            yield negated
        case ast.Expr(value=ast.Call() | ast.Await()) | ast.Raise() | ast.AugAssign():
            yield ast.Pass()
        case ast.Return(value=value) if value is not None and not _is_none(value):
            yield ast.Return(value=ast.Constant(value=None))
        case _:
            return


def _is_none(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


class _Replace(ast.NodeTransformer):
    def __init__(self, number: int, new: ast.AST) -> None:
        self._number, self._new, self._seen = number, new, -1

    def visit(self, node: ast.AST) -> ast.AST:
        self._seen += 1
        if self._seen == self._number:
            return ast.copy_location(self._new, node)
        return super().generic_visit(node)


def _nodes(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield nodes in the order in which `_Replace` counts them."""
    yield tree
    for child in ast.iter_child_nodes(tree):
        yield from _nodes(child)


def _in_function(tree: ast.Module) -> set[int]:
    """Return the ids of nodes inside of functions, their signatures and docstrings left out."""
    inside: set[int] = set()
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            for statement in function.body:
                is_docstring = isinstance(statement, ast.Expr) and isinstance(
                    statement.value, ast.Constant
                )
                if not is_docstring:
                    inside.update(id(node) for node in ast.walk(statement))
    return inside


def mutants_of(file: Path) -> Iterator[Mutant]:
    """Yield every mutant of a file."""
    text = file.read_text(encoding="utf-8")
    tree = ast.parse(text)
    plain = ast.unparse(tree).splitlines()
    inside = _in_function(tree)
    for number, node in enumerate(_nodes(tree)):
        if id(node) not in inside or isinstance(node, ast.JoinedStr | ast.FormattedValue):
            continue
        for new in _changed_nodes(node):
            changed = _Replace(number, new).visit(copy.deepcopy(tree))
            source = ast.unparse(ast.fix_missing_locations(changed))
            pairs = zip(plain, source.splitlines(), strict=False)
            differing = next(((a, b) for a, b in pairs if a != b), None)
            if differing is not None:
                before, after = (one.strip() for one in differing)
                yield Mutant(file, getattr(node, "lineno", 0), before, after, source)


def _copy_tree(to: Path) -> None:
    ignored = shutil.ignore_patterns("__pycache__", ".mypy_cache")
    for name in COPIED:
        shutil.copytree(ROOT / name, to / name, ignore=ignored)
    for name in SINGLE:
        shutil.copy(ROOT / name, to / name)


def _is_found(tree: Path, mutant: Mutant, tests: list[str], timeout_s: float) -> bool:
    """Return whether a test fails on the mutant, or does not end."""
    target = tree / mutant.file.relative_to(ROOT)
    original = target.read_text(encoding="utf-8")
    target.write_text(mutant.source, encoding="utf-8")
    try:
        ended = subprocess.run(  # noqa: S603 - our own tests
            [sys.executable, "-B", "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests],
            cwd=tree,
            env={**os.environ, "PYTHONPATH": str(tree), "CI": "1"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return True
    finally:
        target.write_text(original, encoding="utf-8")
    return ended.returncode != 0


def main() -> int:
    """Fly the mutants; exit code 1 when one survived."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("of", nargs="+", type=Path, help="files or folders that get faults")
    parser.add_argument("--tests", nargs="+", default=["tests/safety"])
    parser.add_argument("--sample", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--timeout-s", type=float, default=300.0)
    parser.add_argument("--list", action="store_true")
    options = parser.parse_args()
    files = sorted(
        file
        for path in options.of
        for file in ([ROOT / path] if path.suffix == ".py" else (ROOT / path).rglob("*.py"))
    )
    everything = [mutant for file in files for mutant in mutants_of(file)]
    draw = random.Random(options.seed)  # noqa: S311 - which mutants are tried is no secret
    drawn = draw.sample(everything, min(options.sample, len(everything)))
    print(f"{len(everything)} mutants of {len(files)} files, {len(drawn)} drawn")
    if options.list:
        for mutant in drawn:
            print(mutant)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        trees = [Path(folder) / str(number) for number in range(options.jobs)]
        for tree in trees:
            _copy_tree(tree)
        survivors = _survivors(drawn, trees, options.tests, options.timeout_s)
    found = len(drawn) - len(survivors)
    print(f"found {found} of {len(drawn)} ({100.0 * found / max(1, len(drawn)):.0f} %)")
    return 1 if survivors else 0


def _survivors(
    drawn: list[Mutant], trees: list[Path], tests: list[str], timeout_s: float
) -> list[Mutant]:
    survivors: list[Mutant] = []
    free = list(trees)

    def try_one(mutant: Mutant) -> None:
        tree, began_s = free.pop(), time.monotonic()
        try:
            found = _is_found(tree, mutant, tests, timeout_s)
        finally:
            free.append(tree)
        word = "found   " if found else "SURVIVED"
        print(f"{word} {time.monotonic() - began_s:5.1f} s  {mutant}", flush=True)
        if not found:
            survivors.append(mutant)

    with ThreadPoolExecutor(len(trees)) as pool:
        list(pool.map(try_one, drawn))
    return survivors


if __name__ == "__main__":
    sys.exit(main())
