"""What a process pays for its first kernel, and where kernels are cached."""

import os
import pwd
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path

import pytest

from wil_campaign.worlds import jit

_FIRST_KERNEL = """
import sys
import numpy as np
from wil_campaign.worlds.jit import jit_inlined

@jit_inlined
def doubled(value):
    return 2.0 * value

assert doubled(1.5) == 3.0
assert "scipy.linalg" not in sys.modules

import numba

assert np.array_equal(numba.njit(lambda a, b: a @ b)(np.eye(2), np.eye(2)), np.eye(2))
"""


def test_the_first_kernel_imports_no_linear_algebra_and_others_still_have_it() -> None:
    subprocess.run(  # noqa: S603 - our own words
        [sys.executable, "-c", _FIRST_KERNEL], check=True, timeout=120.0
    )


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for temporary files, where NUMBA_CACHE_DIR is beneath a file and cannot be made."""
    (tmp_path / "file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "kernels"))
    folder = tmp_path / "tmp"
    folder.mkdir(mode=0o700)
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def find() -> jit.KernelCache:
    return jit.find_kernel_cache.__wrapped__()


def test_kernels_are_cached_in_a_private_folder_of_tmpdir_where_no_other_is_writable(
    temporary: Path,
) -> None:
    found = find()
    assert found.folder is not None
    assert found.folder.parent == temporary
    assert found.folder.stat().st_mode & 0o777 == 0o700
    assert [one.rpartition(": ")[2] for one in found.passed_over] == ["Not a directory"]
    assert find() == found


@pytest.mark.parametrize("trap", ["open", "link", "shared", "foreign"])
def test_no_kernel_is_loaded_from_a_folder_that_another_user_could_write(
    temporary: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trap: str
) -> None:
    folder = find().folder
    assert folder is not None
    match trap:
        case "open":
            folder.chmod(0o770)
        case "link":
            folder.rmdir()
            folder.symlink_to(tmp_path)
        case "shared":
            temporary.chmod(0o777)
        case "foreign":
            mine = os.getuid()
            monkeypatch.setattr("os.getuid", lambda: mine + 1)
            folder.rename(temporary / folder.name.replace(f"wil-{mine}", f"wil-{mine + 1}"))
    found = find()
    assert found.folder is None
    assert len(found.passed_over) == 2


def test_a_user_without_a_home_has_kernels_beside_the_package_or_in_tmpdir(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def unknown(uid: int) -> None:
        raise KeyError(uid)

    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    beside, last = jit._places("kernels-0")
    assert beside == Path(jit.__file__).parent / "__pycache__" / "kernels-0"
    assert last == Path(tempfile.gettempdir()) / f"wil-{os.getuid()}-kernels-0"


def test_without_a_cache_a_kernel_is_compiled_in_each_process(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(jit, "cache_folder", lambda _: None)

    @jit.jit_compiled
    def doubled(value: float) -> float:
        return 2.0 * value

    assert doubled(1.5) == 3.0
    assert not jit.is_kernel_cached(doubled)


def test_the_key_of_the_cache_has_the_sources_of_all_kernels_that_a_kernel_may_call() -> None:
    root = jit._HERE.parent
    shared = {*(root / file for file in jit._KERNEL_FILES), *(root / "worlds/render").glob("*.py")}
    files = [
        file
        for package in ("worlds", "vehicles", "plugins", "recipes")
        for file in (root / package).glob("**/*.py")
        if "@jit_compiled" in file.read_text("utf-8")
    ]
    assert {"px4_kernel.py", "copter_kernel.py"} <= {file.name for file in files}
    for file in files:
        name = ".".join(("wil_campaign", *file.relative_to(root).with_suffix("").parts))
        for kernel in vars(import_module(name)).values():
            if isinstance(kernel, jit._Kernel):
                source = Path(kernel.__code__.co_filename)
                assert source.parent == file.parent or source in shared, (name, source)
