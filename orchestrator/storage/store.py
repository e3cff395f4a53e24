"""A store of files at a URL, S3 or whatever else fsspec reaches: reads and writes, each bounded.

A store may be full, slow, refuse or vanish. Each call is tried a few times, in a thread that is
left behind when the store does not answer in time, and then raises with what the store said.
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
    """A store does not do what it was asked for: says where and why."""


class StoreRefusedError(StoreError):
    """A text is no URL of a store that this machine can use: says why, and the remedy."""


@dataclass(frozen=True, slots=True)
class StoreLimits:
    """How patient a store is used. tries: of each call. pauses_s: between them.

    answer_s: how long a try may take, and as long again as its bytes take at least_bytes_s.
    """

    tries: int = 3
    pauses_s: tuple[float, ...] = (1.0, 3.0)
    answer_s: float = 30.0
    least_bytes_s: float = 250_000.0

    def patience_s(self, size: int) -> float:
        """Return how long one try with so many bytes may take."""
        return self.answer_s + size / self.least_bytes_s


@dataclass(frozen=True, slots=True)
class Store:
    """Files by their names beneath a URL. files: the file system of fsspec. root: the URL's path.

    Every method raises StoreError.
    """

    url: str
    files: Any
    root: str
    limits: StoreLimits = field(default_factory=StoreLimits)

    def read(self, name: str) -> bytes | None:
        """Return what a file has; None where there is none."""

        def read() -> bytes | None:
            try:
                content: bytes = self.files.cat_file(self._path(name))
            except FileNotFoundError:
                return None
            return content

        return self._retry_call(f"{self.url}/{name} cannot be read", read)

    def write(self, name: str, content: bytes) -> None:
        """Write a file, in place of an older one."""
        self._retry_call(
            f"{self.url}/{name} cannot be written",
            lambda: self.files.pipe_file(self._path(name), content),
            len(content),
        )

    def upload(self, name: str, path: Path) -> None:
        """Write a file from one of this machine."""
        self._retry_call(
            f"{self.url}/{name} cannot be written",
            lambda: self.files.put_file(str(path), self._path(name)),
            path.stat().st_size,
        )

    def download(self, name: str, path: Path, size: int) -> None:
        """Write a file's content to one of this machine. size: what it should have."""
        self._retry_call(
            f"{self.url}/{name} cannot be read",
            lambda: self.files.get_file(self._path(name), str(path)),
            size,
        )

    def _path(self, name: str) -> str:
        return f"{self.root}/{name}"

    def _retry_call(self, failing: str, call: Callable[[], T], size: int = 0) -> T:
        """Return what a call returns, at one of its tries."""
        limits, said = self.limits, ""
        for number in range(limits.tries):
            if number:
                time.sleep(limits.pauses_s[min(number, len(limits.pauses_s)) - 1])
            try:
                return _within(limits.patience_s(size), call)
            except Exception as error:  # noqa: BLE001  # whatever a file system of fsspec raises
                said = str(error) or type(error).__name__
        raise StoreError(f"{failing}: {said}, at the last of {limits.tries} tries")


def open_store(url: str, limits: StoreLimits | None = None) -> Store:
    """Return the store at a URL; nothing is connected to. Raises StoreRefusedError."""
    parts = urlsplit(url)
    if not parts.scheme or not (parts.netloc + parts.path).strip("/"):
        raise StoreRefusedError(f"--store {url}: must be a URL such as s3://BUCKET/PREFIX")
    if "@" in parts.netloc or parts.query:
        raise StoreRefusedError(
            f"--store {parts.scheme}://...: credentials do not belong into the URL, which is "
            "recorded; give them to every node as its environment or its files say (AWS_PROFILE)"
        )
    try:
        from fsspec.core import url_to_fs  # noqa: PLC0415  # of an extra
    except ImportError as error:
        raise StoreRefusedError(_missing(url, "fsspec")) from error
    options = {"auto_mkdir": True} if parts.scheme in {"file", "local"} else {}
    try:
        files, root = url_to_fs(
            url.rstrip("/"), use_listings_cache=False, skip_instance_cache=True, **options
        )
    except ImportError as error:
        raise StoreRefusedError(_missing(url, str(error))) from error
    except Exception as error:
        raise StoreRefusedError(f"--store {url}: {error}") from error
    return Store(url.rstrip("/"), files, str(root).rstrip("/"), limits or StoreLimits())


def _missing(url: str, what: str) -> str:
    return (
        f"--store {url} needs the extra storage on this machine and on every node: pip install "
        f"'wil-campaign[storage]' ({what})"
    )


def _within(limit_s: float, call: Callable[[], T]) -> T:
    """Return what a call returns within a time; raises what it raises, or TimeoutError."""
    results: list[T] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            results.append(call())
        except BaseException as error:  # noqa: BLE001  # raised again by who waits
            errors.append(error)

    # A thread that ends with the process: a call that hangs keeps nothing from ending.
    thread = threading.Thread(target=run, name="store", daemon=True)
    thread.start()
    thread.join(limit_s)
    if errors:
        raise errors[0]
    if results:
        return results[0]
    raise TimeoutError(_TIMED_OUT.format(limit_s))
