"""Runs through the S3 protocol, to a server on loopback that is full, slow, refuses or vanishes."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path

import psutil
import pytest

from tests.plugins.cluster.test_stored_runs import FILES, contents, ignore
from tests.ports import free_port
from wil_campaign.plugins.cluster.store import Store, StoreError, StoreLimits, open_store
from wil_campaign.plugins.cluster.stored_runs import begin_run, fetch_run, send_run

for name in ("s3fs", "moto", "flask_cors"):
    # Imported where it is needed: each worker that collects would take half a second for it.
    if find_spec(name) is None:
        pytest.skip(f"needs the extras storage and test: {name}", allow_module_level=True)

SERVER = """\
import sys, time, boto3
from moto.server import ThreadedMotoServer
server = ThreadedMotoServer(ip_address="127.0.0.1", port=int(sys.argv[1]), verbose=False)
server.start()
boto3.client("s3", endpoint_url=f"http://127.0.0.1:{sys.argv[1]}").create_bucket(Bucket="wil")
print("up", flush=True)
time.sleep(600)
"""
ACCESS = {
    "AWS_ACCESS_KEY_ID": "test",
    "AWS_SECRET_ACCESS_KEY": "test",
    "AWS_DEFAULT_REGION": "us-east-1",
}
PATIENT = StoreLimits(tries=2, pauses_s=(0.1,), answer_s=30.0)
BRIEF = StoreLimits(tries=2, pauses_s=(0.1,), answer_s=1.0)


@pytest.fixture(scope="module")
def server() -> Iterator[psutil.Process]:
    """A server for all tests here, which takes seconds to start; one of them kills it, the last."""
    port = free_port()
    with pytest.MonkeyPatch.context() as patch, ExitStack() as stack:
        for name, value in {**ACCESS, "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}"}.items():
            patch.setenv(name, value)
        process = stack.enter_context(
            subprocess.Popen(  # noqa: S603 - our own interpreter
                [sys.executable, "-c", SERVER, str(port)],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
        )
        stack.callback(process.kill)
        assert process.stdout is not None
        assert process.stdout.readline() == b"up\n"
        yield psutil.Process(process.pid)


@pytest.fixture
def flown(tmp_path: Path) -> Path:
    for name, content in FILES.items():
        path = tmp_path / "flown" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return tmp_path / "flown"


def test_a_run_comes_back_from_a_bucket(
    server: psutil.Process, flown: Path, tmp_path: Path
) -> None:
    (flown / "run.mcap").write_bytes(bytes(range(256)) * 40_000)
    store = open_store("s3://wil/nightly", PATIENT)
    assert not fetch_run(store, "gate/1", tmp_path / "here", ignore)
    assert begin_run(store, "gate/1", "desk")
    send_run(store, "gate/1", flown, ignore)
    assert fetch_run(store, "gate/1", tmp_path / "here", ignore)
    assert contents(tmp_path / "here") == contents(flown)
    assert server.is_running()


def test_a_missing_bucket_is_an_error_with_its_name(server: psutil.Process) -> None:
    with pytest.raises(StoreError, match="s3://nowhere/x/gate/1/begun cannot be written"):
        begin_run(open_store("s3://nowhere/x", PATIENT), "gate/1", "desk")
    assert server.is_running()


def test_a_server_that_stands_still_is_left_in_time(server: psutil.Process) -> None:
    store = open_store("s3://wil/nightly", BRIEF)
    server.suspend()
    try:
        began_s = time.monotonic()
        with pytest.raises(StoreError, match="has not answered for 1 s"):
            store.read("gate/1/sent.json")
        assert time.monotonic() - began_s < 20
    finally:
        server.resume()


def test_a_server_that_vanishes_is_an_error_with_its_address(
    server: psutil.Process, flown: Path
) -> None:
    store: Store = open_store("s3://wil/vanishes", BRIEF)
    assert begin_run(open_store("s3://wil/vanishes", PATIENT), "gate/1", "desk")
    server.kill()
    server.wait()
    with pytest.raises(StoreError, match=r"s3://wil/vanishes/gate/1/\S+ cannot be written"):
        send_run(store, "gate/1", flown, ignore)
