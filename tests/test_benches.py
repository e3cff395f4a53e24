"""Benches of mixing still run, and what does not hang on the machine holds in a short one too."""

import importlib.util
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

BENCH = Path(__file__).parents[1] / "bench"


@pytest.fixture
def benchmark(request: pytest.FixtureRequest) -> Iterator[Any]:
    name = f"bench_{request.param}"
    spec = importlib.util.spec_from_file_location(name, BENCH / f"{request.param}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules[name]


@pytest.mark.parametrize("benchmark", ["registration"], indirect=True)
def test_overlays_are_within_a_pixel_when_poses_are_interpolated(
    benchmark: Any,
) -> None:
    """1 m/s sideways, 3 m away, 100 ms of camera latency, motion capture of 100 Hz and 1 mm."""
    interpolated, latest = (benchmark.fly(align, 1.5) for align in ("interpolate", "latest"))
    assert interpolated.dropped == latest.dropped == 0
    assert len(interpolated.errors_px) > 20
    assert np.median(interpolated.errors_px) < 0.5
    assert np.median(interpolated.moved_px) < 1.0
    # A tenth of a second late at 1 m/s, seen at 3 m with a focal length of 466 px.
    assert 10.0 < np.median(latest.errors_px) < 20.0
    assert np.median(latest.moved_px) == pytest.approx(np.median(latest.errors_px), abs=1.5)


@pytest.mark.parametrize("benchmark", ["memory"], indirect=True)
def test_the_mixtures_of_the_memory_benchmark_come_about(benchmark: Any) -> None:
    mixers = benchmark.mixers_of_all_kinds()
    made = benchmark.mix_some(mixers, benchmark.Readings(), 0, 1)
    assert made == sum(
        rate * (2 if name == "camera" else 1) for name, rate in benchmark.RATES_HZ.items()
    )
    late = {mixer.sensor: mixer.counts() for mixer in mixers if mixer.sensor != "camera"}
    assert late["imu"].mixed == 200
    assert late["sound"].mixed == 20
    assert benchmark.resident_mb() > 10.0


_INJECTOR = """
import json, sys
for seed in range(int(sys.argv[1]), int(sys.argv[1]) + int(sys.argv[2])):
    if seed == 12:
        sys.exit("broken")
    one = {"fault": {"seed": seed, "victim": "guard"}, "verdict": "PASS", "reason": "", "lost": []}
    print(json.dumps(one), flush=True)
"""


@pytest.mark.parametrize("benchmark", ["faults"], indirect=True)
def test_results_of_faults_are_kept_as_they_come_and_not_injected_again(
    benchmark: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "tests" / "faults").mkdir(parents=True)
    (tmp_path / "tests" / "faults" / "fake.py").write_text(_INJECTOR)
    monkeypatch.setattr(benchmark, "ROOT", tmp_path)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    keep = tmp_path / "keep"

    def inject(seeds: range) -> list[str]:
        kept = benchmark.Kept(keep, "real")
        return [
            "; ".join(one["lost"]) or one["verdict"]
            for one in benchmark.in_shares(("fake",), seeds, 1, tmp_path, kept)
        ]

    assert inject(range(10, 14)) == ["PASS", "PASS", *["the injector ended: broken"] * 2]
    lines = (keep / "real.jsonl").read_text().splitlines()
    assert [json.loads(line)["fault"]["seed"] for line in lines] == [10, 11]
    with (keep / "real.jsonl").open("a") as stream:
        stream.write('{"fault": {"seed": 9, ')  # cut off
    (tmp_path / "tests" / "faults" / "fake.py").write_text(_INJECTOR.replace("== 12", "< 12"))
    # Seed 10 would end the injector now: it is kept, and with it the figures of before.
    assert inject(range(10, 14)) == ["PASS"] * 4
    assert len((keep / "real.jsonl").read_text().splitlines()) == 4
