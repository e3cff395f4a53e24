"""A store that is full, slow, refuses or vanishes is given up with what it said, and in time."""

import errno
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from wil_campaign.plugins.cluster.store import (
    Store,
    StoreError,
    StoreLimits,
    StoreRefusedError,
    open_store,
)

pytest.importorskip("fsspec", reason="needs the extra storage")

QUICK = StoreLimits(tries=3, pauses_s=(0.01, 0.01), answer_s=30.0)


class Faulty:
    """A file system that does what it is told before it does what it is asked."""

    def __init__(self, act: Callable[[int], object]) -> None:
        self._act = act
        self.calls = 0

    def _call(self) -> None:
        self.calls += 1
        self._act(self.calls)

    def cat_file(self, _: str) -> bytes:
        self._call()
        return b"content"

    def pipe_file(self, _: str, __: bytes) -> None:
        self._call()

    def put_file(self, _: str, __: str) -> None:
        self._call()

    def get_file(self, _: str, __: str) -> None:
        self._call()


def faulty(act: Callable[[int], object], limits: StoreLimits = QUICK) -> tuple[Store, Faulty]:
    files = Faulty(act)
    return Store("s3://bucket/here", files, "bucket/here", limits), files


def full(_: int) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_file_system_of_fsspec_keeps_what_is_written(tmp_path: Path) -> None:
    store = open_store(f"file://{tmp_path}/store/")
    assert store.url == f"file://{tmp_path}/store"
    assert store.read("a/b") is None
    store.write("a/b", b"one")
    store.write("a/b", b"two")
    assert store.read("a/b") == b"two"
    (tmp_path / "up").write_bytes(b"three")
    store.upload("deep/er/file", tmp_path / "up")
    store.download("deep/er/file", tmp_path / "down", 5)
    assert (tmp_path / "down").read_bytes() == b"three"


def test_a_full_store_is_tried_again_and_then_given_up_with_its_word(tmp_path: Path) -> None:
    store, files = faulty(full)
    with pytest.raises(StoreError, match=r"s3://bucket/here/x cannot be written.*No space left"):
        store.write("x", b"")
    assert files.calls == 3
    (tmp_path / "one").touch()
    with pytest.raises(StoreError, match="last of 3 tries"):
        store.upload("x", tmp_path / "one")


def test_a_store_that_answers_at_the_second_try_is_none_the_worse() -> None:
    def once(call: int) -> None:
        if call == 1:
            raise ConnectionResetError("reset")

    store, files = faulty(once)
    assert store.read("x") == b"content"
    assert files.calls == 2


def test_a_store_that_hangs_is_left_in_time() -> None:
    store, files = faulty(lambda _: time.sleep(30), replace(QUICK, answer_s=0.3))
    began_s = time.monotonic()
    with pytest.raises(StoreError, match=r"has not answered for 0\.3 s"):
        store.read("x")
    assert time.monotonic() - began_s < 5
    assert files.calls == 3


def test_a_file_that_is_not_there_is_not_asked_for_again() -> None:
    def missing(_: int) -> None:
        raise FileNotFoundError("x")

    store, files = faulty(missing)
    assert store.read("x") is None
    assert files.calls == 1


def test_more_bytes_are_given_more_time() -> None:
    assert StoreLimits().limit_s(250_000_000) > 900 > StoreLimits().limit_s(0)


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("bucket/prefix", "must be a URL such as s3://BUCKET/PREFIX"),
        ("s3://", "must be a URL"),
        ("s3://key:secret@bucket", "must not contain credentials"),
        ("s3://bucket?token=1", "must not contain credentials"),
        ("nothing://bucket", "--store nothing://bucket"),
    ],
)
def test_an_address_that_is_no_store_is_refused(url: str, said: str) -> None:
    with pytest.raises(StoreRefusedError, match=said) as raised:
        open_store(url)
    assert "secret" not in str(raised.value)


def test_a_missing_extra_is_named_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    with pytest.raises(StoreRefusedError, match=r"pip install 'wil-campaign\[cluster,storage\]'"):
        open_store("s3://bucket")
