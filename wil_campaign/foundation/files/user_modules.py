"""Modules of the user's: a file that a campaign names, and what it imports from beside it.

Each folder is a package of its own in `sys.modules`, so that two folders with modules of one name,
and modules named like installed packages or ours, never meet. Within it `import helper` and `from
.helper import x` find what stands beside the file, as Python finds it beside a script; everybody
else's imports go their own way. Of all that the folder's code imports, the files are kept with the
digest of what was run.
"""

import builtins
import hashlib
import importlib
import re
import sys
import sysconfig
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import find_spec
from pathlib import Path
from types import CodeType, FrameType, ModuleType
from typing import Any

from wil_campaign.foundation.files.paths import is_file

_PREFIX = "wil_user_"
_PACKAGE = re.compile(rf"\b{_PREFIX}\w{{12}}\.?")
_OURS = "wil_campaign"
_INSTALLED = frozenset({"site-packages", "dist-packages"})
_LOCK = threading.RLock()


class UserFolder:
    """A folder of the user's with Python files, as a package of its own.

    place: the folder. files: what its code has imported so far, by resolved path, with SHA-256; not
    what is installed, nor the standard library, nor this program.
    """

    def __init__(self, place: Path) -> None:
        self.place = place
        self.files: dict[Path, str] = {}
        self._package = _PREFIX + hashlib.sha256(bytes(place)).hexdigest()[:12]
        root = place
        while _is_package(root):
            root = root.parent
        within = ".".join(place.relative_to(root).parts)
        self._inner = f"{self._package}.{within}" if within else self._package
        self._places = {self._inner: str(place), self._package: str(root)}
        package = ModuleType(self._package)
        package.__path__ = [str(root)]
        sys.modules[self._package] = package
        self._builtins = {**vars(builtins), "__import__": self._import}

    def load(self, stem: str) -> ModuleType:
        """Return the module of a file in the folder, run at most once. Raises what it raises."""
        importlib.invalidate_caches()  # the file may be younger than the last look at its folder
        return importlib.import_module(f"{self._inner}.{stem}")

    def prepare(self, module: ModuleType) -> None:
        """Have the imports of a module, which is about to run, look in this folder first."""
        vars(module)["__builtins__"] = self._builtins

    def _import(
        self,
        name: str,
        globals: Mapping[str, object] | None = None,  # noqa: A002 - as of __import__
        locals: Mapping[str, object] | None = None,  # noqa: A002
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> ModuleType:
        """Import for a module of the folder: what stands beside it, else as everybody does."""
        top = name.partition(".")[0]
        importer = str((globals or {}).get("__name__", ""))
        package = self._package_of(top, importer) if level == 0 else None
        wanted = f"{package}.{name}" if package else name
        try:
            found = builtins.__import__(wanted, globals, locals, fromlist or (), level)
        except ModuleNotFoundError as error:
            if not (error.name or "").startswith(_PREFIX):
                raise
            raise ModuleNotFoundError(
                with_user_module_names(str(error)), name=with_user_module_names(error.name or "")
            ) from None
        if package:
            return found if fromlist else sys.modules[f"{package}.{top}"]
        if level == 0 and top not in sys.stdlib_module_names:
            self._keep_imported(name, fromlist or ())
        return found

    def _package_of(self, top: str, importer: str) -> str | None:
        """Return the package in which a top-level name stands: this folder, or above it.

        None where it is nothing of the user's. A name is one module however it is imported, also
        where the folder is itself a package. A folder without `__init__.py` is a package only where
        nothing else has the name, as in Python. A module never means itself.
        """
        if top in {_OURS, *sys.builtin_module_names}:
            return None
        bare = None
        for package, place in self._places.items():
            spec = PathFinder.find_spec(f"{package}.{top}", [place])
            if spec is None or spec.name == importer:
                continue
            if spec.has_location:
                return package
            bare = bare or package
        return bare if bare and _is_unknown(top) else None

    def _keep_imported(self, name: str, fromlist: Sequence[str]) -> None:
        parts = name.split(".")
        names = [".".join(parts[: end + 1]) for end in range(len(parts))]
        for one in (*names, *(f"{name}.{attribute}" for attribute in fromlist)):
            file = getattr(sys.modules.get(one), "__file__", None)
            if isinstance(file, str):
                self.keep(file)

    def keep(self, file: str) -> None:
        """Keep a file that the folder's code had run, if it is the user's own."""
        path = user_file_path(file)
        if path is not None and path not in self.files:
            with suppress(OSError):  # it is gone; who imports it does not mind
                self.files[path] = _digest(path.read_bytes())

    def keep_run(self, file: str, content: bytes) -> None:
        """Keep a file of which this content was run."""
        path = user_file_path(file)
        if path is not None:
            self.files[path] = _digest(content)


_folders: dict[str, UserFolder] = {}


def user_folder(place: Path) -> UserFolder:
    """Return the package of a folder, which is resolved; made at the first call."""
    with _LOCK:
        _install()
        package = _PREFIX + hashlib.sha256(bytes(place)).hexdigest()[:12]
        if package not in _folders or package not in sys.modules:  # somebody has cleared these
            _folders[package] = UserFolder(place)
        return _folders[package]


def user_files(place: Path) -> dict[Path, str]:
    """Return what code of a folder has imported in this process so far, with SHA-256."""
    return dict(folder.files) if (folder := _folder_at(place)) is not None else {}


def keep_user_files(place: Path, files: Mapping[Path, str]) -> None:
    """Keep what code of a folder has imported in another process, which checked it."""
    user_folder(place).files.update(files)


def all_user_files() -> dict[Path, str]:
    """Return what code of every folder has imported in this process so far, with SHA-256."""
    return {
        path: digest
        for folder in list(_folders.values())
        for path, digest in list(folder.files.items())
    }


def forget_user_modules() -> None:
    """Forget all modules of the user's folders, so that they run anew."""
    with _LOCK:
        _folders.clear()
        for name in [name for name in sys.modules if name.startswith(_PREFIX)]:
            del sys.modules[name]


def with_user_module_names(text: str) -> str:
    """Return a text with the names of modules as the user's files have them."""
    return _PACKAGE.sub("", text)


def user_file_path(file: str) -> Path | None:
    """Return the resolved path of a file of the user's own; None for anything else.

    A module in a zip file is that file.
    """
    if file.startswith(("<", _ours())):
        return None
    path = next((one for one in (Path(file), *Path(file).parents) if is_file(one)), None)
    if path is None or not path.is_absolute():
        return None
    path = path.resolve()
    library = any(path.is_relative_to(one) for one in _standard_library())
    installed = not _INSTALLED.isdisjoint(path.parts)
    return None if library or installed else path


def _folder_at(place: Path) -> UserFolder | None:
    return next((folder for folder in _folders.values() if folder.place == place), None)


def _is_package(folder: Path) -> bool:
    """Return whether a folder is a package of the user's; a shipped autonomy is in none."""
    is_ours = any(folder.is_relative_to(our_folder) for our_folder in _our_folders())
    return not is_ours and folder.name.isidentifier() and is_file(folder / "__init__.py")


@cache
def _our_folders() -> tuple[Path, ...]:
    """Return the folders of this program, resolved: a checkout has links to them."""
    return tuple(path.resolve() for path in Path(_ours()).iterdir() if path.is_dir())


@cache
def _ours() -> str:
    """Return where the modules of this program are, by the name by which they are imported."""
    return f"{Path(__file__).parents[2]}/"


@cache
def _standard_library() -> tuple[Path, ...]:
    return tuple({Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib")})


def _is_unknown(top: str) -> bool:
    """Return whether nobody else has a top-level module of this name."""
    try:
        return top not in sys.stdlib_module_names and find_spec(top) is None
    except (ImportError, ValueError):
        return True


def _digest(content: bytes) -> str:
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


class _Loader(SourceFileLoader):
    """Runs a Python file of the user's: always its source, of which it keeps the digest."""

    def __init__(self, fullname: str, path: str, folder: UserFolder) -> None:
        super().__init__(fullname, path)
        self._folder = folder

    def path_stats(self, path: Any) -> Any:  # noqa: ARG002 - as of SourceLoader
        """Say that there is no bytecode: it is stale where a file is changed within a second."""
        raise OSError

    def get_data(self, path: str) -> bytes:
        """Return the content of a file, which is run, and keep its digest."""
        content = super().get_data(path)
        self._folder.keep_run(path, content)
        return content

    def exec_module(self, module: ModuleType) -> None:
        """Run a module of the user's, whose imports look beside it first."""
        self._folder.prepare(module)
        super().exec_module(module)


class _Finder(MetaPathFinder):
    """Finds the modules of the users' folders, and nothing else."""

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,
        target: ModuleType | None = None,  # noqa: ARG002 - as of MetaPathFinder
    ) -> ModuleSpec | None:
        """Return the spec of a module of a user's folder; None for any other module."""
        folder = _folders.get(fullname.partition(".")[0])
        if folder is None:
            return None
        spec = PathFinder.find_spec(fullname, path)
        if spec is not None and isinstance(spec.loader, SourceFileLoader) and spec.origin:
            spec.loader = _Loader(fullname, spec.origin, folder)
        return spec


_FINDER = _Finder()


def _install() -> None:
    """Install the finder, and what sees files run that no import statement shows."""
    if _FINDER not in sys.meta_path:
        sys.meta_path.insert(0, _FINDER)
    _watch_executed()


@cache
def _watch_executed() -> None:
    sys.addaudithook(_see_executed)


def _see_executed(event: str, arguments: tuple[Any, ...]) -> None:
    """Keep a file that is run for the user's code, however it was found (an audit hook)."""
    if event == "exec" and isinstance(arguments[0], CodeType):
        file: object = arguments[0].co_filename
    elif event == "import":
        file = arguments[1]  # of an extension module
    else:
        return
    if not isinstance(file, str) or file.startswith("<") or not _folders:
        return
    for folder in _running_folders(sys._getframe(1)):  # noqa: SLF001 - documented for this use
        folder.keep(file)


def _running_folders(frame: FrameType | None) -> Iterator[UserFolder]:
    """Yield the folders whose code is running, from the innermost frame outwards."""
    while frame is not None:
        name = frame.f_globals.get("__name__")
        if isinstance(name, str) and name.startswith(_PREFIX):
            folder = _folders.get(name.partition(".")[0])
            if folder is not None:
                yield folder
        frame = frame.f_back
