"""A search whose flights fly over a cluster, or in the fence of a bench."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.plugins.cluster.bench.test_bench_engine import write_bench
from tests.plugins.cluster.fake_ray import FakeRay
from tests.plugins.cluster.test_ray_engine import MortalAgent
from tests.plugins.search.searches import SEARCH, write_search
from wil_campaign.orchestrator.cli import main
from wil_campaign.plugins.cluster import ray_engine

BRIEF = (
    SEARCH.replace("steps: 3", "steps: 2")
    .replace("sim: 3", "sim: 2")
    .replace("reduce: 4", "reduce: 0")
)
ASKING = {"modes: [sim]": "modes: [sim, real]\nbench: hall-a"}
OF_BENCH = """\
    fence: {key: geofence.box.up_m.1, from: 5, to: 500}
  objective"""


def write_asking(folder: Path, search: str = BRIEF) -> tuple[Path, str]:
    """Write a search whose campaign asks for a bench; return it with the bench's file."""
    path = write_search(folder, search)
    text = path.read_text()
    for old, new in ASKING.items():
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return path, str(write_bench(folder).document.path)


def document_of(out: Path) -> dict[str, Any]:
    (path,) = out.glob("hover/search/*/search.json")
    found: dict[str, Any] = json.loads(path.read_text())
    for cost in found["costs"]:
        cost["wall_s"] = 0.0
    return found


def test_a_search_over_a_cluster_finds_the_same_with_workers_that_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, ray = write_search(tmp_path, BRIEF), FakeRay(MortalAgent)

    @contextmanager
    def running(address: str | None, *, cpus: int) -> Iterator[FakeRay]:
        assert (address, cpus) == (None, 1)
        try:
            yield ray
        finally:
            for actor in ray.actors:
                actor.die()

    monkeypatch.setattr(ray_engine, "running_ray", running)
    words = ["search", str(path), "--jobs", "1", "--out"]
    assert main([*words, str(tmp_path / "local")]) == 1
    assert main([*words, str(tmp_path / "cluster"), "--engine", "ray"]) == 1
    assert document_of(tmp_path / "cluster") == document_of(tmp_path / "local")
    batches = sorted((tmp_path / "cluster").glob("hover/search/*/flights/*/ledger.jsonl"))
    assert len(batches) >= 2
    assert len(ray.actors) == 1


def test_a_search_flies_in_the_fence_of_a_bench_and_not_its_vehicle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, bench = write_asking(tmp_path)
    out = tmp_path / "out"
    assert main(["search", str(path), "--out", str(out)]) == 2
    assert "asks for a bench" in capsys.readouterr().err
    words = ["search", str(path), "--out", str(out), "--bench-file", bench]
    assert main([*words, "--set", "search.budget={sim: 2, real: 2}"]) == 2
    assert "real of bench hall-a: a search flies no attached vehicle" in capsys.readouterr().err
    assert not out.exists()
    assert main([*words, "--jobs", "1"]) == 1
    (failure,) = out.glob("hover/search/*/failures/*.yaml")
    assert "bench: hall-a" in failure.read_text()
    assert "geofence:" not in failure.read_text()
    assert main(["validate", str(failure), "--bench-file", bench]) == 0


def test_a_search_varies_no_key_of_its_bench(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, bench = write_asking(tmp_path, BRIEF.replace("  objective", OF_BENCH))
    assert main(["search", str(path), "--out", str(tmp_path), "--bench-file", bench]) == 2
    said = capsys.readouterr().err
    assert "'geofence.box.up_m.1': geofence is defined by bench hall-a" in said
    assert "hover.yaml:" in said


def test_an_unknown_engine_is_exit_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main(["search", str(write_search(tmp_path)), "--engine", "rai", "--out", str(out)]) == 2
    assert "must be local, ray or ray://HOST:PORT" in capsys.readouterr().err
    assert not out.exists()
