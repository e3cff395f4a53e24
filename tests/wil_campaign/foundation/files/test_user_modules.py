"""Modules of the user's: found beside the file that imports them, and nowhere else."""

import hashlib
import importlib
import importlib.util
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from wil_campaign.foundation.files.references import BadReferenceError, load_reference
from wil_campaign.foundation.files.user_modules import (
    forget_user_modules,
    user_file_path,
    user_files,
)


@pytest.fixture(autouse=True)
def _forgotten() -> Iterator[None]:
    forget_user_modules()
    yield
    forget_user_modules()


def write(folder: Path, **files: str) -> Path:
    """Write modules into a folder, by their path without the suffix."""
    for name, text in files.items():
        path = folder / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def seen(folder: Path, file: str = "mine.py") -> object:
    return load_reference(f"{file}:SEEN", folder)


@pytest.mark.parametrize(
    "statement",
    [
        "from helper import V as SEEN",
        "import helper; SEEN = helper.V",
        "import helper as h; SEEN = h.V",
        "from .helper import V as SEEN",
        "from . import helper; SEEN = helper.V",
        "import pkg.deep; SEEN = pkg.deep.V",
        "import pkg.deep as d; SEEN = d.V",
        "from pkg import deep; SEEN = deep.V",
        "from pkg.deep import *; SEEN = V",
        "from .pkg.deep import V as SEEN",
        "from bare.inner import V as SEEN",
        "def later():\n    import helper\n    return helper.V\nSEEN = later()",
    ],
)
def test_a_file_imports_what_stands_beside_it(tmp_path: Path, statement: str) -> None:
    folder = write(
        tmp_path,
        mine=statement,
        helper="V = 'theirs'",
        **{
            "pkg/__init__": "from . import deep",
            "pkg/deep": "import helper\n__all__ = ['V']\nV = helper.V",
            "bare/inner": "V = 'theirs'",
        },
    )
    assert seen(folder) == "theirs"
    assert "helper" not in sys.modules
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("helper")


@pytest.mark.parametrize("name", ["vehicles", "safety", "numpy", "yaml", "random", "pydantic"])
def test_a_module_beside_a_file_may_have_any_other_name(tmp_path: Path, name: str) -> None:
    """Of ours, of an installed package, of the standard library, as beside a script."""
    before = sys.modules.get(name)
    mine = f"import {name}\nfrom helper import N\nSEEN = ({name}.V, N)"
    folder = write(tmp_path, mine=mine, **{name: "V = 1"})
    write(folder, helper=f"from {name} import V as N")
    assert seen(folder) == (1, 1)
    assert sys.modules.get(name) is before


def test_a_folder_without_code_hides_no_package(tmp_path: Path) -> None:
    (tmp_path / "numpy").mkdir()
    (tmp_path / "json").mkdir()
    folder = write(tmp_path, mine="import json, numpy\nSEEN = numpy.pi > 3 and json.dumps(1)")
    assert seen(folder) == "1"


def test_a_file_with_the_name_of_a_module_that_it_imports_gets_that_module(tmp_path: Path) -> None:
    folder = write(tmp_path, random="import random\nSEEN = random.Random(1).random()")
    assert seen(folder, "random.py") == pytest.approx(0.134, abs=1e-3)


def test_two_folders_have_modules_of_one_name(tmp_path: Path) -> None:
    one = write(tmp_path / "one", mine="from helper import SEEN", helper="SEEN = 1")
    two = write(tmp_path / "two", mine="from helper import SEEN", helper="SEEN = 2")
    assert (seen(one), seen(two), seen(one)) == (1, 2, 1)


def test_a_linked_folder_is_that_folder(tmp_path: Path) -> None:
    write(tmp_path / "there", mine="from helper import SEEN", helper="SEEN = [1]")
    (tmp_path / "here").symlink_to(tmp_path / "there")
    assert seen(tmp_path / "here") is seen(tmp_path / "there")


def test_a_package_of_the_users_imports_from_above(tmp_path: Path) -> None:
    files = {
        "lab/__init__": "",
        "lab/common": "V = 1",
        "lab/flight/__init__": "",
        "lab/flight/mine": "from ..common import V\nfrom lab.common import V as W\nSEEN = (V, W)",
    }
    folder = write(tmp_path, **files)
    assert load_reference("lab/flight/mine.py:SEEN", folder) == (1, 1)


def test_a_module_within_a_package_is_one_however_it_is_imported(tmp_path: Path) -> None:
    files = {
        "lab/__init__": "",
        "lab/store": "from .gains import K",
        "lab/gains": "K = 1",
        "lab/mine": "import store\nfrom . import store as b\nfrom lab import store as c\n"
        "SEEN = store is b is c and store.K",
    }
    assert load_reference("lab/mine.py:SEEN", write(tmp_path, **files)) == 1


def test_a_module_within_a_package_never_means_itself(tmp_path: Path) -> None:
    files = {"lab/__init__": "", "lab/random": "import random\nSEEN = random.Random(1).random()"}
    seen = load_reference("lab/random.py:SEEN", write(tmp_path, **files))
    assert seen == pytest.approx(0.134, abs=1e-3)


def test_a_copy_of_a_shipped_folder_and_a_shipped_file_are_loaded_as_the_users(
    tmp_path: Path,
) -> None:
    shipped = Path(__file__).parents[4] / "campaigns"
    shutil.copytree(shipped / "autonomies", tmp_path / "campaigns" / "autonomies")
    shutil.copy(shipped / "__init__.py", tmp_path / "campaigns")
    for folder in (shipped, tmp_path / "campaigns"):
        found = load_reference("autonomies/straight.py:StraightAutonomy", folder)
        assert str(vars(found)["__module__"]).startswith("wil_user_")


def test_a_module_on_the_path_is_imported_as_usual(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(write(tmp_path / "path", elsewhere_of_ours="V = 1")))
    folder = write(tmp_path / "mine", mine="from elsewhere_of_ours import V as SEEN")
    assert seen(folder) == 1


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({"mine": "\nimport nowhere"}, "line 2: ModuleNotFoundError: No module named 'nowhere'"),
        (
            {"mine": "import helper", "helper": "\n\n1 / 0"},
            "helper.py, line 3: ZeroDivisionError: division by zero",
        ),
        (
            {"mine": "from .nowhere import x"},
            "line 1: ModuleNotFoundError: No module named 'nowhere'",
        ),
        (
            {"mine": "import a_of_ours", "a_of_ours": "from b_of_ours import B\nA = 1"}
            | {"b_of_ours": "from a_of_ours import A\nB = 1"},
            "b_of_ours.py, line 1: ImportError: cannot import name 'A' from partially",
        ),
        (
            {"mine": "import helper", "helper": "x = = 1"},
            "SyntaxError: invalid syntax (helper.py, line 1)",
        ),
    ],
)
def test_a_failure_is_reported_with_its_file_and_line(
    tmp_path: Path, files: dict[str, str], said: str
) -> None:
    with pytest.raises(BadReferenceError) as caught:
        seen(write(tmp_path, **files))
    assert str(caught.value).startswith(f"'mine.py' cannot be loaded: {said}")
    assert "wil_user" not in str(caught.value)


@pytest.mark.parametrize("taken", ["wil_campaign", "wil_campaign/__init__"])
def test_a_module_called_as_this_program_is_refused(tmp_path: Path, taken: str) -> None:
    folder = write(tmp_path, mine="import wil_campaign.api\nSEEN = 1", **{taken: ""})
    with pytest.raises(BadReferenceError, match="has the name of this program"):
        seen(folder)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
def test_a_folder_that_cannot_be_read_is_reported(tmp_path: Path) -> None:
    folder = write(tmp_path / "closed", mine="SEEN = 1")
    for above in (tmp_path, *tmp_path.parents):
        if above.stat().st_uid == 0 and above != Path("/") and "pytest" in above.parts[-1]:
            above.chmod(0o755)
    folder.chmod(0o700)
    os.seteuid(12345)
    try:
        with pytest.raises(BadReferenceError, match="cannot be read: Permission denied"):
            load_reference("closed/mine.py:SEEN", tmp_path)
    finally:
        os.seteuid(0)


WAYS = {
    "beside": "import helper_of_ours",
    "relative": "from . import helper_of_ours",
    "sys.path": "import sys; sys.path.insert(0, {there!r}); import helper_of_ours; del sys.path[0]",
    "PYTHONPATH": "import helper_of_ours",
    "editable": "import helper_of_ours",
    "importlib": "import importlib; importlib.import_module('helper_of_ours')",
    "a spec": "import importlib.util as u\ns = u.spec_from_file_location('x', {there!r} + "
    "'/helper_of_ours.py')\ns.loader.exec_module(u.module_from_spec(s))",
    "exec": "from pathlib import Path\np = Path({there!r}, 'helper_of_ours.py')\n"
    "exec(compile(p.read_text(), str(p), 'exec'), {{}})",
    "runpy": "import runpy; runpy.run_path({there!r} + '/helper_of_ours.py')",
    "in a function": "def act():\n    import helper_of_ours\nact()",
}


class Redirector(importlib.abc.MetaPathFinder):
    """What an editable installation puts beside the path."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def find_spec(
        self, fullname: str, path: object, target: object = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != self.file.stem:
            return None
        return importlib.util.spec_from_file_location(fullname, self.file)


@pytest.mark.parametrize("way", WAYS)
def test_each_file_that_code_of_the_users_runs_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    mine = tmp_path / "mine"
    there = mine if way in {"beside", "relative", "in a function"} else tmp_path / "there"
    write(there, helper_of_ours=f"V = {way!r}")
    if way in {"PYTHONPATH", "importlib"}:
        monkeypatch.syspath_prepend(str(there))
    if way == "editable":
        monkeypatch.setattr(
            sys, "meta_path", [*sys.meta_path, Redirector(there / "helper_of_ours.py")]
        )
    monkeypatch.delitem(sys.modules, "helper_of_ours", raising=False)
    write(mine, mine=WAYS[way].format(there=str(there)) + "\nSEEN = 1")
    assert seen(mine) == 1
    monkeypatch.delitem(sys.modules, "helper_of_ours", raising=False)
    found = user_files(mine)
    assert set(found) == {mine / "mine.py", there / "helper_of_ours.py"}
    content = (there / "helper_of_ours.py").read_bytes()
    assert found[there / "helper_of_ours.py"] == f"sha256:{hashlib.sha256(content).hexdigest()}"


def test_a_module_that_other_code_imported_before_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(write(tmp_path / "path", before_of_ours="V = 1")))
    importlib.import_module("before_of_ours")
    folder = write(tmp_path / "mine", mine="from before_of_ours import V as SEEN")
    assert seen(folder) == 1
    assert tmp_path / "path" / "before_of_ours.py" in user_files(folder)


def test_an_installed_package_is_no_file_of_the_user(tmp_path: Path) -> None:
    folder = write(tmp_path, mine="import json, numpy, wil_campaign.api\nSEEN = 1")
    seen(folder)
    assert set(user_files(folder)) == {folder / "mine.py"}
    assert user_file_path("<string>") is None
    assert user_file_path(str(importlib.import_module("numpy").__file__)) is None


def test_a_file_that_changes_within_a_second_is_run_as_it_is(tmp_path: Path) -> None:
    """Bytecode goes by size and second."""
    folder = write(tmp_path, mine="from helper import SEEN", helper="SEEN = 1")
    assert seen(folder) == 1
    forget_user_modules()
    write(folder, helper="SEEN = 2")
    assert seen(folder) == 2
    assert not list(folder.rglob("*.pyc"))
