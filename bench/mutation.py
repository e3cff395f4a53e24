"""Put faults into the code, one at a time, and see whether a test finds each.

    python -m bench.mutation --over orchestrator/run --count 40 --seed 1 --log /tmp/mutation.jsonl

Each mutant is one change of one expression or statement in a copy of the tree: a comparison that is
strict where it was not, a condition that is negated, a constant that is another, a sum that is a
difference, `and` for `or`, a statement that is gone, a result that is None. What decides (a
comparison, a condition, an exception) is drawn three times as often as what does not. The tests run
on it until the first one fails: those of the module's own test file, then of the folder that
mirrors its package, then `--tests`. What failed on a mutant has to pass without it. A mutant that
no test finds is a survivor, printed with its line before and after; the last line is the share that
was found. `--list` prints the mutants and runs nothing; with `--log` an interrupted run is resumed.
"""

import argparse
import ast
import copy
import itertools
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
COPIED = (
    "bench",
    "campaigns",
    "orchestrator",
    "plugins",
    "recipes",
    "safety",
    "tests",
    "vehicles",
    "wil_campaign",
    "worlds",
    "docs",
)
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
FAILED = ("FAILED ", "ERROR ")
"""How pytest begins the lines that name what failed."""
DECIDES = (ast.Compare, ast.BoolOp, ast.UnaryOp, ast.If, ast.While, ast.Raise)
DECIDES_WEIGHT = 3.0


@dataclass(frozen=True)
class Candidate:
    """A change that may be drawn: the `choice`-th of the `number`-th node of a file."""

    file: Path
    number: int
    choice: int
    weight: float


@dataclass(frozen=True)
class Mutant:
    """One change of a file. source: the whole file with the change."""

    file: str
    line: int
    before: str
    after: str
    source: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.before}  ->  {self.after}"


@dataclass(frozen=True)
class Outcome:
    """What came of a mutant. found_by: the test that failed; None of a survivor."""

    mutant: str
    found_by: str | None
    wall_s: float


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


def _judged_nodes(tree: ast.Module) -> set[int]:
    """Return the ids of nodes that get faults: bodies of functions, and values of constants."""
    inside: set[int] = set()
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(body=body) | ast.AsyncFunctionDef(body=body):
                taken: list[ast.AST] = [one for one in body if not _is_docstring(one)]
            case ast.Module(body=body) | ast.ClassDef(body=body):
                values = (one for one in body if isinstance(one, ast.Assign | ast.AnnAssign))
                taken = [value.value for value in values if value.value is not None]
            case _:
                continue
        inside.update(id(part) for one in taken for part in ast.walk(one))
    return inside


def _is_docstring(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def candidates_of(file: Path) -> Iterator[Candidate]:
    """Yield every change of a file that may be drawn."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    inside = _judged_nodes(tree)
    for number, node in enumerate(_nodes(tree)):
        if id(node) in inside and not isinstance(node, ast.JoinedStr | ast.FormattedValue):
            weight = DECIDES_WEIGHT if isinstance(node, DECIDES) else 1.0
            for choice, _ in enumerate(_changed_nodes(node)):
                yield Candidate(file, number, choice, weight)


def mutant_of(candidate: Candidate) -> Mutant | None:
    """Return a file with a change made; None if that makes the same file."""
    file = candidate.file
    tree = ast.parse(file.read_text(encoding="utf-8"))
    plain = ast.unparse(tree).splitlines()
    node = list(_nodes(tree))[candidate.number]
    new = list(_changed_nodes(node))[candidate.choice]
    changed = _Replace(candidate.number, new).visit(tree)
    source = ast.unparse(ast.fix_missing_locations(changed))
    pairs = zip(plain, source.splitlines(), strict=False)
    before, after = next(((a.strip(), b.strip()) for a, b in pairs if a != b), ("", ""))
    if before == after:
        return None
    return Mutant(str(file.relative_to(ROOT)), getattr(node, "lineno", 0), before, after, source)


def draw(files: list[Path], count: int, seed: int) -> tuple[list[Mutant], int]:
    """Return mutants drawn at random by weight, and of how many."""
    everything = [candidate for file in files for candidate in candidates_of(file)]
    chance = random.Random(seed)  # noqa: S311 - which mutants are tried is no secret
    keyed = sorted(everything, key=lambda one: -(chance.random() ** (1.0 / one.weight)))
    mutants = (mutant_of(one) for one in keyed)
    return list(itertools.islice(filter(None, mutants), count)), len(everything)


def ladder_of(file: str, wider: list[str]) -> list[list[str]]:
    """Return what pytest is given on the way from a module's own tests to all that may find."""
    source = Path("tests") / file
    own = source.with_name(f"test_{source.name}")
    folder = next(parent for parent in source.parents if (ROOT / parent).is_dir())
    steps = [[str(own)]] if (ROOT / own).exists() else []
    return [*steps, [str(folder), "--ignore", str(own)], *([wider] if wider else [])]


class Tree:
    """A copy of the project in which mutants are tried."""

    def __init__(self, folder: Path, timeout_s: float) -> None:
        self._folder = folder
        self._timeout_s = timeout_s
        ignored = shutil.ignore_patterns("__pycache__", ".mypy_cache")
        # The package leads to its folders by links: a copy of each would hide the mutant.
        for name in COPIED:
            shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=ignored)
        for name in SINGLE:
            shutil.copy(ROOT / name, folder / name)

    def finder_of(self, mutant: Mutant, wider: list[str]) -> str | None:
        """Return the first test that fails on a mutant, or what did not end in time."""
        target = self._folder / mutant.file
        original = target.read_text(encoding="utf-8")
        target.write_text(mutant.source, encoding="utf-8")
        try:
            steps = (self._failing(tests) for tests in ladder_of(mutant.file, wider))
            found = next(filter(None, steps), [])
        finally:
            target.write_text(original, encoding="utf-8")
        if found and self._failing(found):
            raise SystemExit(f"{' '.join(found)} fails without the mutant too")
        return " ".join(found) or None

    def _failing(self, tests: list[str]) -> list[str]:
        """Return the first test that fails, all if they do not end in time, none if none does."""
        pytest = [sys.executable, "-B", "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
        try:
            ended = subprocess.run(  # noqa: S603 - our own tests
                [*pytest, *tests],
                cwd=self._folder,
                env={**os.environ, "PYTHONPATH": str(self._folder), "CI": "1"},
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                timeout=self._timeout_s,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return tests
        if ended.returncode in (0, 5):  # 5: no test was collected
            return []
        lines = (one for one in ended.stdout.splitlines() if one.startswith(FAILED))
        # Of all cases of a test: the id of one may have characters that no command line takes.
        named = (line.partition(" ")[2].partition(" - ")[0].partition("[")[0] for line in lines)
        return next(([one] for one in named), tests)


def main() -> int:
    """Try the mutants; exit code 1 when one survived."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--over", nargs="+", type=Path, required=True, help="what gets faults")
    parser.add_argument("--tests", nargs="+", default=[], help="run after the mirrored folder's")
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--timeout-s", type=float, default=1800.0)
    parser.add_argument("--log", type=Path, help="gets a line of JSON for each mutant")
    parser.add_argument("--list", action="store_true")
    options = parser.parse_args()
    files = sorted(
        file
        for path in options.over
        for file in ([ROOT / path] if path.suffix == ".py" else (ROOT / path).rglob("*.py"))
    )
    drawn, among = draw(files, options.count, options.seed)
    print(f"{among} mutants of {len(files)} files, {len(drawn)} drawn", flush=True)
    if options.list:
        print(*drawn, sep="\n")
        return 0
    known = _outcomes_in(options.log)
    with tempfile.TemporaryDirectory() as folder:
        trees = [Tree(Path(folder) / str(k), options.timeout_s) for k in range(options.jobs)]
        left = [one for one in drawn if str(one) not in known]
        _try_all(left, trees, options.tests, known, options.log)
    found = sum(known[str(one)].found_by is not None for one in drawn)
    print(f"found {found} of {len(drawn)} ({100.0 * found / max(1, len(drawn)):.0f} %)")
    return 0 if found == len(drawn) else 1


def _outcomes_in(log: Path | None) -> dict[str, Outcome]:
    """Return what a log has already, by mutant."""
    if log is None or not log.exists():
        return {}
    lines = log.read_text(encoding="utf-8").splitlines()
    return {one.mutant: one for one in (Outcome(**json.loads(line)) for line in lines)}


def _try_all(
    mutants: list[Mutant],
    trees: list[Tree],
    wider: list[str],
    known: dict[str, Outcome],
    log: Path | None,
) -> None:
    """Try mutants and add what comes of each to the known."""
    free = list(trees)

    def try_one(mutant: Mutant) -> None:
        tree, began_s = free.pop(), time.monotonic()
        try:
            found_by = tree.finder_of(mutant, wider)
        finally:
            free.append(tree)
        outcome = Outcome(str(mutant), found_by, round(time.monotonic() - began_s, 1))
        known[outcome.mutant] = outcome
        word = "SURVIVED" if found_by is None else "found   "
        print(f"{word} {outcome.wall_s:6.1f} s  {mutant}  {found_by or ''}", flush=True)
        if log is not None:
            with log.open("a", encoding="utf-8") as lines:
                lines.write(json.dumps(asdict(outcome)) + "\n")

    with ThreadPoolExecutor(len(trees)) as pool:
        list(pool.map(try_one, mutants))


if __name__ == "__main__":
    sys.exit(main())
