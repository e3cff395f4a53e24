"""A store of files at a URL, S3 or anything else that fsspec supports, with time limits.

A store may be full, slow, refuse access or vanish. Each call is tried a few times, in a thread that
is abandoned when the store does not answer in time, and then raises the store's error.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

T = TypeVar("T")
_TIMED_OUT = "it has not answered for {:g} s"


class StoreError(Exception):
    """A call of a store failed; says where and why."""


class MissingFileError(StoreError):
    """A file is not in a store, which has answered; says where."""


class StoreRefusedError(StoreError):
    """A URL names no store that this machine can use; says why, and the remedy."""


@dataclass(frozen=True, slots=True)
class StoreLimits:
    """Time limits of a store. tries: of each call. pauses_s: between tries.

    answer_s: the limit of a try, to which the time of its bytes at least_bytes_s is added.
    """

    tries: int = 3
    pauses_s: tuple[float, ...] = (1.0, 3.0)
    answer_s: float = 30.0
    least_bytes_s: float = 250_000.0

    def limit_s(self, size: int) -> float:
        """Return the time limit of a try with so many bytes."""
        return self.answer_s + size / self.least_bytes_s


@dataclass(frozen=True, slots=True)
class Store:
    """Files by their names beneath a URL. files: the file system of fsspec. root: the URL's path.

    Every method raises StoreError, `download` MissingFileError for a file that does not exist.
    """

    url: str
    files: Any
    root: str
    limits: StoreLimits = field(default_factory=StoreLimits)

    def read(self, name: str) -> bytes | None:
        """Return a file's content; None if it does not exist."""

        def read() -> bytes | None:
            try:
                content: bytes = self.files.cat_file(self._path(name))
            except FileNotFoundError:
                return None
            return content

        return self._retry_call(f"{self.url}/{name} cannot be read", read)

    def write(self, name: str, content: bytes) -> None:
        """Write a file, or replace it."""
        self._retry_call(
            f"{self.url}/{name} cannot be written",
            lambda: self.files.pipe_file(self._path(name), content),
            len(content),
        )

    def upload(self, name: str, path: Path) -> None:
        """Copy a file of this machine to the store."""
        self._retry_call(
            f"{self.url}/{name} cannot be written",
            lambda: self.files.put_file(str(path), self._path(name)),
            path.stat().st_size,
        )

    def download(self, name: str, path: Path, size: int) -> None:
        """Copy a file to this machine. size: in bytes, as expected."""
        self._retry_call(
            f"{self.url}/{name} cannot be read",
            lambda: self.files.get_file(self._path(name), str(path)),
            size,
        )

    def _path(self, name: str) -> str:
        return f"{self.root}/{name}"

    def _retry_call(self, failure: str, call: Callable[[], T], size: int = 0) -> T:
        """Return the result of a call that is tried several times."""
        limits, reason = self.limits, ""
        kind: type[StoreError] = StoreError
        for number in range(limits.tries):
            if number:
                time.sleep(limits.pauses_s[min(number, len(limits.pauses_s)) - 1])
            try:
                return _call_within(limits.limit_s(size), call)
            except Exception as error:  # noqa: BLE001  # file systems of fsspec raise anything
                reason = str(error) or type(error).__name__
                kind = MissingFileError if isinstance(error, FileNotFoundError) else StoreError
        raise kind(f"{failure}: {reason} (the last of {limits.tries} tries)")


def open_store(url: str, limits: StoreLimits | None = None) -> Store:
    """Return the store at a URL, without connecting to it. Raises StoreRefusedError."""
    parts = urlsplit(url)
    if not parts.scheme or not (parts.netloc + parts.path).strip("/"):
        raise StoreRefusedError(f"--store {url}: must be a URL such as s3://BUCKET/PREFIX")
    if "@" in parts.netloc or parts.query:
        raise StoreRefusedError(
            f"--store {parts.scheme}://...: the URL is recorded and must not contain credentials; "
            "give them to every node by its environment or credential files (AWS_PROFILE)"
        )
    try:
        from fsspec.core import url_to_fs  # noqa: PLC0415  # of an extra
    except ImportError as error:
        raise StoreRefusedError(_missing_extra_text(url, "fsspec")) from error
    options = {"auto_mkdir": True} if parts.scheme in {"file", "local"} else {}
    try:
        files, root = url_to_fs(
            url.rstrip("/"), use_listings_cache=False, skip_instance_cache=True, **options
        )
    except ImportError as error:
        raise StoreRefusedError(_missing_extra_text(url, str(error))) from error
    except Exception as error:
        raise StoreRefusedError(f"--store {url}: {error}") from error
    return Store(url.rstrip("/"), files, str(root).rstrip("/"), limits or StoreLimits())


def _missing_extra_text(url: str, what: str) -> str:
    return (
        f"--store {url} needs an extra on this machine and on every node: pip install "
        f"'wil-campaign[cluster,storage]' ({what})"
    )


def _call_within(limit_s: float, call: Callable[[], T]) -> T:
    """Return the result of a call within a time; raises its exception, or TimeoutError."""
    results: list[T] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            results.append(call())
        except BaseException as error:  # noqa: BLE001  # raised again in the waiting thread
            errors.append(error)

    # A daemon thread: a call that hangs does not keep the process from ending.
    thread = threading.Thread(target=run, name="store", daemon=True)
    thread.start()
    thread.join(limit_s)
    if errors:
        raise errors[0]
    if results:
        return results[0]
    raise TimeoutError(_TIMED_OUT.format(limit_s))
