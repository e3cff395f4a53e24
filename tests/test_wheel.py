"""A wheel of this checkout: one top-level name, every file of git, and the commit."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.test_house import ROOT
from wil_campaign.orchestrator.installation import UNKNOWN_COMMIT, _commit_of_checkout

pytest.importorskip("hatchling", reason="the extra dev has it")
FOLDERS = ("orchestrator", "vehicles", "recipes", "campaigns", "safety", "worlds", "plugins")


def build(root: Path, target: str, place: Path) -> Path:
    """Return the archive that hatchling builds of a checkout, by what is installed here."""
    subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-P", "-m", "hatchling", "build", "-t", target, "-d", str(place)],
        cwd=root,
        env={key: text for key, text in os.environ.items() if key != "PYTHONPATH"},
        check=True,
        capture_output=True,
    )
    (archive,) = place.glob("*.whl" if target == "wheel" else "*.tar.gz")
    return archive


def names_in(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return {name for name in archive.namelist() if ".dist-info/" not in name}


def test_a_wheel_has_one_name_all_files_and_the_commit(tmp_path: Path) -> None:
    listed = subprocess.run(  # noqa: S603
        ["git", "ls-files", "-z", *FOLDERS, "wil_campaign/*.py", "wil_campaign/py.typed"],  # noqa: S607
        cwd=ROOT,
        check=False,
        capture_output=True,
        text=True,
    )
    if listed.returncode != 0:
        pytest.skip("no checkout of git")
    files = {name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()}
    assert len(files) > 1000
    commit = _commit_of_checkout(ROOT)
    wheel = build(ROOT, "wheel", tmp_path)
    found = names_in(wheel)
    assert {name.split("/")[0] for name in found} == {"wil_campaign"}
    expected = {f"wil_campaign/{name.removeprefix('wil_campaign/')}" for name in files}
    assert expected - found == set()
    assert not [name for name in found if "__pycache__" in name or name.endswith((".nbi", ".nbc"))]
    assert not [name for name in files if name.endswith((".orig", ".rej"))]  # left by a merge
    with zipfile.ZipFile(wheel) as archive:
        assert archive.read("wil_campaign/COMMIT").decode().strip() == commit != UNKNOWN_COMMIT
    assert not (ROOT / "COMMIT").exists()


def small_checkout(root: Path) -> None:
    """Write what a build takes of this checkout, with a file in each folder; no links, no git."""
    for name in ("pyproject.toml", "README.md", "LICENSE", ".gitignore", ".ci/build_hook.py"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, root / name)
    for name in ("__init__.py", "__main__.py", "api.py", "py.typed"):
        (root / "wil_campaign").mkdir(exist_ok=True)
        shutil.copy(ROOT / "wil_campaign" / name, root / "wil_campaign" / name)
    (root / "wil_campaign" / "foundation").mkdir()
    (root / "wil_campaign" / "foundation" / "__init__.py").touch()
    for folder in FOLDERS:
        (root / folder).mkdir()
        (root / folder / "__init__.py").touch()
        # As `unzip` of Python leaves a link behind: a file with its target.
        (root / "wil_campaign" / folder).write_text(f"../{folder}")


def test_an_sdist_hands_its_commit_on_and_results_of_flights_stay_at_home(tmp_path: Path) -> None:
    root = tmp_path / "root"
    root.mkdir()
    small_checkout(root)
    (root / "campaigns" / "results").mkdir()
    (root / "campaigns" / "results" / "run.mcap").touch()
    (root / "COMMIT").write_text("0" * 40)
    sdist = build(root, "sdist", tmp_path / "dist")
    (tmp_path / "unpacked").mkdir()
    subprocess.run(["tar", "-xf", sdist, "-C", tmp_path / "unpacked"], check=True)  # noqa: S603, S607
    (again,) = (tmp_path / "unpacked").iterdir()
    for place in (root, again):
        wheel = build(place, "wheel", tmp_path / place.name)
        own = {f"wil_campaign/{name}" for name in ("__main__.py", "api.py", "py.typed", "COMMIT")}
        packages = {f"wil_campaign/{folder}/__init__.py" for folder in (*FOLDERS, "foundation")}
        assert names_in(wheel) == own | packages | {"wil_campaign/__init__.py"}
        with zipfile.ZipFile(wheel) as archive:
            assert archive.read("wil_campaign/COMMIT") == b"0" * 40
