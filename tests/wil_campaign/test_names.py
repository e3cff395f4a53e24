"""The program has one import name; what stands at the top of the repository has no second one."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import wil_campaign

ROOT = Path(__file__).parents[2]
SHOW = "import wil_campaign.api as a; print(a.Pose.__module__, a.__file__)"
FOLDERS = ("campaigns", "orchestrator", "plugins", "recipes", "safety", "vehicles", "worlds")


@pytest.mark.parametrize("name", FOLDERS)
def test_a_folder_of_the_repository_is_no_module_of_its_own(name: str) -> None:
    """Also where the checkout is on the path: no module is there under two names."""
    code = f"import wil_campaign.{name}; import {name}"
    done = subprocess.run(  # noqa: S603 - our own interpreter
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    last = done.stderr.splitlines()[-1]
    assert last == f"ImportError: import wil_campaign.{name}, not {name}: a module has one name"


@pytest.mark.parametrize("name", wil_campaign.__all__)
def test_each_public_name_is_found_where_the_table_says(name: str) -> None:
    assert getattr(wil_campaign, name) is not None
    assert name in dir(wil_campaign)


def test_a_checkout_whose_links_were_lost_is_imported(tmp_path: Path) -> None:
    """As unpacked by Python's zipfile, which writes the target of a link into a file."""
    archive = tmp_path / "checkout.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        own = ROOT / "wil_campaign"
        for path in (*own.glob("*.py"), *(own / "foundation").rglob("*.py")):
            packed.write(path, path.relative_to(ROOT))
        for folder in FOLDERS:
            packed.writestr(f"wil_campaign/{folder}", f"../{folder}")
            for path in (ROOT / folder).rglob("*.py"):
                packed.write(path, f"{folder}/{path.relative_to(ROOT / folder)}")
    with zipfile.ZipFile(archive) as packed:
        packed.extractall(tmp_path / "unpacked")
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "import wil_campaign.api as a; print(a.Pose.__module__, a.__file__)",
        ],
        cwd=tmp_path / "unpacked",
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == [
        "wil_campaign.worlds.frames",
        str(tmp_path / "unpacked" / "wil_campaign" / "api.py"),
    ]
