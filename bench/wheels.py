"""Asks pip for which Pythons and systems all dependencies have wheels, and prints a table.

    python -m bench.wheels [--extras search,logs] [--python 3.11,3.13] [-- PIP OPTIONS]

Each cell is one `pip install --dry-run` of pip's own index (or that of PIP OPTIONS) without source
distributions; nothing is installed. A dependency without a wheel is named.
"""

import argparse
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
SYSTEMS: Mapping[str, tuple[str, ...]] = {
    "Linux x86-64": ("manylinux_2_28_x86_64", "manylinux2014_x86_64"),
    "Linux arm64": ("manylinux_2_28_aarch64", "manylinux2014_aarch64"),
    "macOS arm64": ("macosx_14_0_arm64", "macosx_11_0_arm64"),
    "Windows x86-64": ("win_amd64",),
}
"""By system the platforms of wheels that run there."""
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
_NONE = re.compile(r"No matching distribution found for ([^\s(]+)")
_LONGEST_S = 600.0
Ask = Callable[[Sequence[str]], tuple[int, str]]
"""Runs a command, and returns its exit code and its errors."""


def requirements(extras: Sequence[str]) -> list[str]:
    """Return the dependencies, with those of extras, as pip reads them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    found = list(project["dependencies"])
    for extra in extras:
        found += project["optional-dependencies"][extra]
    return [str(one) for one in found if not str(one).startswith("wil-campaign[")]


def command(python: str, system: str, wanted: Sequence[str], more: Sequence[str]) -> list[str]:
    """Return the command that asks pip for wheels of a Python and a system."""
    platforms = [word for one in SYSTEMS[system] for word in ("--platform", one)]
    asked = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--ignore-installed"]
    asked += ["--only-binary", ":all:", "--target", "unused", "--python-version", python]
    return [*asked, *platforms, *more, *wanted]


def cell(python: str, system: str, wanted: Sequence[str], more: Sequence[str], ask: Ask) -> str:
    """Return "all", or what has no wheel; pip names the first alone."""
    missing: list[str] = []
    left = list(wanted)
    while left:
        code, errors = ask(command(python, system, left, more))
        if code == 0:
            break
        named = _NONE.findall(errors)
        mine = [one for one in left if any(_name(one) == _name(each) for each in named)]
        if not mine:
            # Of a dependency's own dependency, or no answer at all.
            last = errors.strip().splitlines()[-1:] or ["no answer"]
            missing.append(", ".join(named) or last[0])
            break
        missing += map(_name, mine)
        left = [one for one in left if one not in mine]
    return "all" if not missing else f"not {', '.join(missing)}"


def _name(requirement: str) -> str:
    """Return the name in a requirement, as packages are compared."""
    found = re.match(r"[A-Za-z0-9._-]+", requirement)
    return "" if found is None else re.sub(r"[-_.]+", "-", found[0]).lower()


def run(asked: Sequence[str]) -> tuple[int, str]:
    """Run pip. Raises subprocess.TimeoutExpired."""
    done = subprocess.run(asked, capture_output=True, text=True, timeout=_LONGEST_S, check=False)  # noqa: S603 - pip
    return done.returncode, done.stderr


def main(arguments: Sequence[str] | None = None, *, ask: Ask = run) -> int:
    """Print the table; return 1 where something has no wheel."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--extras", default="", help="of pyproject.toml, with commas")
    parser.add_argument("--python", default=",".join(PYTHONS), help="versions, with commas")
    parser.add_argument("pip", nargs="*", help="options for pip, after --")
    given = parser.parse_args(arguments)
    wanted = requirements([one for one in given.extras.split(",") if one])
    pythons = given.python.split(",")
    print("| Python | " + " | ".join(SYSTEMS) + " |")
    print("|---|" + "---|" * len(SYSTEMS))
    complete = True
    for python in pythons:
        cells = [cell(python, system, wanted, given.pip, ask) for system in SYSTEMS]
        complete = complete and set(cells) == {"all"}
        print(f"| {python} | " + " | ".join(cells) + " |", flush=True)
    return 0 if complete else 1


if __name__ == "__main__":
    sys.exit(main())
