"""A run in a store is there as a whole, with the digests that were sent, or not at all."""

import json
from pathlib import Path

import pytest

from wil_campaign.plugins.cluster.store import Store, StoreError, StoreLimits, open_store
from wil_campaign.plugins.cluster.stored_runs import (
    DamagedRunError,
    await_run,
    begin_run,
    fetch_run,
    read_session,
    send_run,
    write_session,
)

pytest.importorskip("fsspec", reason="needs the extra storage")

FILES = {"result.json": b"{}", "real.tlog": b"abc", "notes/deep.txt": b"", "zz.csv": b"1,2"}


@pytest.fixture
def store(tmp_path: Path) -> Store:
    limits = StoreLimits(tries=2, pauses_s=(0.01,), answer_s=5.0)
    return open_store(f"file://{tmp_path}/store", limits)


@pytest.fixture
def flown(tmp_path: Path) -> Path:
    for name, content in FILES.items():
        path = tmp_path / "flown" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return tmp_path / "flown"


def contents(folder: Path) -> dict[str, bytes]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def ignore(_: int) -> None:
    pass


def test_a_sent_run_arrives_whole_and_its_result_is_sent_last(
    store: Store, flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []
    upload, write = Store.upload, Store.write

    def uploaded(self: Store, name: str, path: Path) -> None:
        order.append(name)
        upload(self, name, path)

    def written(self: Store, name: str, content: bytes) -> None:
        order.append(name)
        write(self, name, content)

    monkeypatch.setattr(Store, "upload", uploaded)
    monkeypatch.setattr(Store, "write", written)
    count: list[int] = []
    send_run(store, "c/1", flown, count.append)
    assert order[-2:] == ["c/1/result.json", "c/1/sent.json"]
    assert count == [1, 2, 3, 4]
    assert fetch_run(store, "c/1", tmp_path / "here", ignore)
    assert contents(tmp_path / "here") == FILES


def test_a_run_that_is_not_all_there_is_not_read(store: Store, flown: Path, tmp_path: Path) -> None:
    send_run(store, "c/1", flown, ignore)
    sent = tmp_path / "store/c/1/sent.json"
    whole = sent.read_bytes()
    for length in range(len(whole)):
        sent.write_bytes(whole[:length])
        assert not fetch_run(store, "c/1", tmp_path / "here", ignore)
    sent.unlink()
    assert not fetch_run(store, "c/1", tmp_path / "here", ignore)
    assert not (tmp_path / "here").exists()


@pytest.mark.parametrize("damage", [b"abd", b"ab", b"", b"abcabc"])
def test_a_file_that_differs_from_the_sent_one_is_refused_without_a_result(
    store: Store, flown: Path, tmp_path: Path, damage: bytes
) -> None:
    send_run(store, "c/1", flown, ignore)
    (tmp_path / "store/c/1/real.tlog").write_bytes(damage)
    with pytest.raises(DamagedRunError, match=r"real\.tlog is not what its node has sent"):
        fetch_run(store, "c/1", tmp_path / "here", ignore)
    assert "result.json" not in contents(tmp_path / "here")
    assert not list((tmp_path / "here").rglob("*.part"))


def test_a_file_that_is_gone_is_an_error(store: Store, flown: Path, tmp_path: Path) -> None:
    send_run(store, "c/1", flown, ignore)
    (tmp_path / "store/c/1/zz.csv").unlink()
    with pytest.raises(DamagedRunError, match=r"zz\.csv cannot be read"):
        fetch_run(store, "c/1", tmp_path / "here", ignore)


def test_a_store_that_fails_says_nothing_about_the_run(
    store: Store, flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    send_run(store, "c/1", flown, ignore)

    def refuse(*_: object) -> None:
        raise PermissionError("access denied")

    monkeypatch.setattr(store.files, "get_file", refuse)
    with pytest.raises(StoreError, match="access denied") as raised:
        fetch_run(store, "c/1", tmp_path / "here", ignore)
    assert not isinstance(raised.value, DamagedRunError)


@pytest.mark.parametrize("name", ["../outside", "/etc/passwd", "a/../../b", ""])
def test_no_name_leads_out_of_the_folder_of_a_run(store: Store, tmp_path: Path, name: str) -> None:
    one = {"sha256": "0" * 64, "size": 0}
    store.write("c/1/sent.json", json.dumps({"files": {name: one}}).encode())
    with pytest.raises(DamagedRunError, match="outside of the run's folder"):
        fetch_run(store, "c/1", tmp_path / "here", ignore)
    assert not (tmp_path / "outside").exists()


def test_a_lost_node_is_waited_for_only_where_it_has_begun(
    store: Store, flown: Path, tmp_path: Path
) -> None:
    here = tmp_path / "here"
    assert begin_run(store, "c/1", "desk")
    assert "has sent nothing" in await_run(store, "c/1", here, landed_s=0, begun_s=0)
    send_run(store, "c/1", flown, ignore)
    assert await_run(store, "c/1", here, landed_s=0, begun_s=0) == ""
    assert contents(here) == FILES


def test_a_run_that_was_given_up_never_begins_and_a_begun_one_is_not_given_up(
    store: Store, tmp_path: Path
) -> None:
    here = tmp_path / "here"
    assert await_run(store, "c/1", here, landed_s=60, begun_s=0) == "it had not begun"
    assert not begin_run(store, "c/1", "desk")
    assert begin_run(store, "c/2", "desk")
    assert "has sent nothing" in await_run(store, "c/2", here, landed_s=0, begun_s=0)


def test_the_newest_start_of_a_campaign_is_what_nodes_read(store: Store) -> None:
    assert read_session(store, "c") == ""
    write_session(store, "c", "one")
    write_session(store, "c", "two")
    assert read_session(store, "c") == "two"
