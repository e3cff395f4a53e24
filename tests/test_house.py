"""The house: layers hold, folders stay small, and names are the words of the field."""

import ast
import itertools
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from tests.conftest import FAST, WALL
from wil_campaign.orchestrator import installation

ROOT = Path(__file__).parents[1]
NOT_PACKAGES = {"tests", "bench", "docs"}

RETIRED = frozenset(
    re.findall(
        r"\w+",
        """
        hangar stations telling aboard journal journals arranging sensing seeing
        perceiving lifting desk reservations honesty honest honoured ward charter leftover
        leftovers steering tape taped insist insisting insistence keeper felt surround surroundings
        stranger strangers told said heard blackout blackouts voice voices pilot pilots pictures
        hangars tellings wards charters desks keepers tapes
        """,
    )
)
"""Words with another meaning in this field, or with none: the field's word takes their place."""
IN_TESTS = frozenset({"pilot", "pilots", "pictures"})
"""Retired for parts of ours alone: tests are about people with a transmitter as well."""
RETIRED_PAIRS = frozenset({"last words", "took back", "take back", "taken up", "led clock"})
WRITTEN = {
    "pictures": "keys of YAML: record.pictures, and quality.pictures of calibration files",
    "blackouts": "a key of YAML",
    "pilot": "a person with a transmitter",
    "PILOT": "a person with a transmitter",
}
"""Variables that keep a retired word, and why: it stands in files of users, or is the field's."""
BARE = frozenset(
    {
        "_asked",
        "_agree",
        "_found",
        "_given",
        "_heard",
        "_held",
        "_kept",
        "_lost",
        "_made",
        "_said",
        "_told",
    }
)
"""Participles alone: a private helper has a verb and an object."""
MODULES_PER_FOLDER = 15
"""Nine folders of ten hold at most so many modules."""


def tools() -> Any:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]


def packages() -> set[str]:
    """The folders of the repository with code of the product."""
    found = {path.parent.name for path in ROOT.glob("*/__init__.py")}
    return found - NOT_PACKAGES


def test_every_package_stands_in_the_contract() -> None:
    contract, *inner, circles = tools()["importlinter"]["contracts"]
    assert (circles["type"], circles["ancestors"]) == ("acyclic_siblings", ["wil_campaign"])
    assert set(circles) == {"id", "name", "type", "ancestors"}, "at any depth, no exception"
    layers = {name.strip() for layer in contract["layers"] for name in layer.split("|")}
    own = {path.stem for path in (ROOT / "wil_campaign").glob("*.py")} - {"__init__"}
    own.add("foundation")
    assert contract["containers"] == ["wil_campaign"]
    assert layers == own | packages() - {"wil_campaign"}
    assert all(one["exhaustive"] and one["type"] == "layers" for one in (contract, *inner))
    held = {name for one in inner for name in one["containers"]}
    large = ("plugins", "orchestrator", "campaigns", "safety", "vehicles")
    assert {f"wil_campaign.{name}" for name in large} == held


def test_every_package_is_checked_built_and_typed() -> None:
    assert set(tools()["mypy"]["packages"]) == {"wil_campaign", "tests"}
    below = packages() - {"wil_campaign"}
    links = {path.name: path for path in (ROOT / "wil_campaign").iterdir() if path.is_symlink()}
    assert {name: path.readlink().as_posix() for name, path in links.items()} == {
        name: f"../{name}" for name in below
    }
    hook = ast.parse((ROOT / tools()["hatch"]["build"]["hooks"]["custom"]["path"]).read_text())
    folders = next(one for one in hook.body if isinstance(one, ast.Assign))
    assert set(ast.literal_eval(folders.value)) == below == set(installation._FOLDERS)
    banned = tools()["ruff"]["lint"]["flake8-tidy-imports"]["banned-api"]
    assert set(banned) == below | {"numba"}, "kernels are compiled by worlds.jit alone"
    assert (ROOT / "wil_campaign" / "py.typed").is_file()


def test_every_folder_of_code_is_a_package() -> None:
    for name in packages():
        for module in (ROOT / name).rglob("*.py"):
            assert (module.parent / "__init__.py").is_file(), module


def test_imports_point_down() -> None:
    code = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    done = subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-c", code, "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def sources() -> Iterator[Path]:
    for name in sorted(packages()):
        yield from sorted((ROOT / name).rglob("*.py"))


def interpreter_flags() -> Iterator[tuple[Path, str]]:
    """Yield the first flag of each command that starts this interpreter with a flag."""
    for path in sources():
        if b"sys.executable" not in (source := path.read_bytes()):
            continue
        for node in ast.walk(ast.parse(source)):
            if not isinstance(node, ast.List | ast.Tuple) or len(node.elts) < 2:
                continue
            first, second = node.elts[:2]
            if ast.unparse(first) == "sys.executable" and isinstance(second, ast.Constant):
                yield path, str(second.value)


def test_no_process_of_ours_imports_from_the_current_folder() -> None:
    """A user flies there, whose autonomy may be called random.py."""
    flags = list(interpreter_flags())
    assert len(flags) >= 9
    assert [(path, flag) for path, flag in flags if flag not in {"-P", "-I"}] == []


def words_of(name: str) -> list[str]:
    """The words of a name, of either form: `SimClock` and `sim_clock` are sim, clock."""
    one_word = name.replace("ArduPilot", "Ardupilot")
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z0-9]+", one_word)]


def retired_in(name: str) -> set[str]:
    words = words_of(name)
    pairs = {f"{one} {other}" for one, other in itertools.pairwise(words)}
    return set(RETIRED.intersection(words) | RETIRED_PAIRS & pairs | BARE & {name})


def names_in(source: str) -> list[str]:
    """The names of classes and functions, also of those in a text: nothing is parsed for them."""
    return re.findall(r"^[ \t]*(?:async )?(?:class|def) (\w+)", source, re.MULTILINE)


def variables_in(source: str) -> Iterator[str]:
    """The names of parameters, and of what is assigned to: variables, attributes, constants."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def test_a_retired_word_is_found_in_any_form() -> None:
    source = "class InHangar:\n def told(self): ...\nasync def _held(): ...\ndef sim(): ..."
    assert {name for name in names_in(source) if retired_in(name)} == {"InHangar", "told", "_held"}
    source = "def f(*, desk=0): said, one = 1, 2\nself._kept = JOURNAL = [last_words for _ in ()]"
    found = {name for name in variables_in(source) if retired_in(name)}
    assert found == {"desk", "said", "_kept", "JOURNAL"}


def retired_names(paths: Iterable[Path], allowed: frozenset[str] = frozenset()) -> list[str]:
    return [
        f"{path.relative_to(ROOT)}: {name}"
        for path in paths
        for name in (path.stem, path.parent.name, *names_in(path.read_text()))
        if retired_in(name) - allowed
    ]


def test_no_name_has_a_retired_word() -> None:
    found = retired_names(sources())
    assert not found, "\n".join(found)


def test_no_variable_has_a_retired_word() -> None:
    found = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in sources()
        for name in variables_in(path.read_text())
        if retired_in(name) and name not in WRITTEN
    }
    assert not found, "\n".join(sorted(found))


def test_no_name_of_a_test_or_benchmark_has_a_retired_word() -> None:
    found = retired_names((ROOT / "tests").rglob("*.py"), IN_TESTS)
    found += retired_names((ROOT / "bench").rglob("*.py"), frozenset({"bench"}))
    assert not found, "\n".join(found)


def test_most_folders_hold_few_modules() -> None:
    counts: dict[Path, int] = {}
    for path in sources():
        if path.name != "__init__.py":
            counts[path.parent] = counts.get(path.parent, 0) + 1
    ordered = sorted(counts.values())
    assert ordered[len(ordered) * 9 // 10] <= MODULES_PER_FOLDER, counts


def decides(source: str) -> bool:
    """Return whether a module has code of its own, and not only imports and constants."""
    return re.search(r"^[ \t]*(?:async )?def ", source, re.MULTILINE) is not None


def without_mirror(folders: Iterable[Path], tests: Path) -> set[str]:
    """Return the folders that have no test file in the same folder beneath `tests`."""
    return {folder.as_posix() for folder in folders if not any((tests / folder).glob("test_*.py"))}


def test_a_folder_without_a_mirror_is_found(tmp_path: Path) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "test_x.py").touch()
    (tmp_path / "a" / "b" / "rigs.py").touch()
    folders = [Path("a"), Path("a/b"), Path("c")]
    assert without_mirror(folders, tmp_path) == {"a/b", "c"}
    assert decides("class A:\n async def f(self): ...")
    assert not decides("from a import b\n__all__ = ['b']")


def test_every_folder_of_code_has_tests_in_the_folder_that_mirrors_it() -> None:
    folders = {path.parent.relative_to(ROOT) for path in sources() if decides(path.read_text())}
    found = without_mirror(folders, ROOT / "tests")
    assert not found, f"move or add tests to these folders in tests/: {sorted(found)}"


def test_the_places_that_tests_are_sorted_by_are_there() -> None:
    root = Path(__file__).parent
    assert [place for place in (*FAST, *WALL) if not (root / place).exists()] == []
