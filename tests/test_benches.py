"""Benches of mixing still run, and what does not hang on the machine holds in a short one too."""

import importlib.util
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wil_campaign.plugins.search.exploration.model import FlightOutcome, SearchVariant
from wil_campaign.plugins.search.exploration.space import SearchSpace, SpaceParameter

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
            "; ".join(in_share["lost"]) or in_share["verdict"]
            for in_share in benchmark.in_shares(("fake",), seeds, 1, tmp_path, kept)
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


_ONE_BOX = {"north1": 10, "east1": 0, "long1": 4, "wide1": 2, "turned1": 0} | {
    "there2": "none",
    "there3": "none",
}
_SECOND = {"there2": "Wv", "north2": 10, "east2": 4, "long2": 2, "wide2": 2, "turned2": 45}


@pytest.mark.parametrize("benchmark", ["competition"], indirect=True)
def test_a_test_of_the_competition_is_scored_by_its_rules(benchmark: Any) -> None:
    def scored(values: dict[str, Any], *near_m: float) -> Any:
        return benchmark.Scored(
            name="v",
            standing="confirmed",
            boxes=len(benchmark.box_numbers(values)),
            nearest_m=near_m,
            minutes=0.5,
            footprint=benchmark.footprint(values),
        )

    near_m = (0.0, 0.24, 0.25, 0.99, 1.0, 1.49, 1.5, float("inf"))
    assert [benchmark.points_of(one) for one in near_m] == [5, 5, 2, 2, 1, 1, 0, 0]
    one, two = scored(_ONE_BOX, 0.0, 0.9, 2.0), scored(_ONE_BOX | _SECOND, 0.0, 0.9, 2.0)
    # (5 + 2 + 0) / 3 x 10 / (1 x 0.5), and a quarter of it with two boxes.
    assert one.score == pytest.approx(46.67, abs=0.01)
    assert two.score == pytest.approx(one.score / 4.0)
    assert one.touched == 1
    across = scored(_ONE_BOX | {"turned1": 90}, 0.0)
    cell_m2 = 0.01
    assert one.footprint.sum() * cell_m2 == pytest.approx(8.0, abs=0.3)
    assert two.footprint.sum() * cell_m2 == pytest.approx(12.0, abs=0.5)
    assert benchmark.diversity([one, across]) == pytest.approx(1.0 - 4.0 / 12.0, abs=0.03)
    assert benchmark.diversity([one, one]) == 0.0
    assert benchmark.diversity([one]) is None


@pytest.mark.parametrize("benchmark", ["search_table"], indirect=True)
def test_a_flight_of_the_table_is_one_of_the_nearest_point(benchmark: Any) -> None:
    def outcome(value: float) -> FlightOutcome:
        return FlightOutcome(verdict="FAIL" if value <= 0.0 else "PASS", value=value)

    points = tuple(
        benchmark.TablePoint(
            variant=SearchVariant(name=f"t{index:04d}", values={"x": x}),
            outcomes=tuple(map(outcome, values)),
        )
        for index, (x, values) in enumerate(
            [(0.0, [0.9]), (0.3, [0.1, -0.1, 0.2]), (0.7, [0.5]), (1.0, [0.7])]
        )
    )
    table = benchmark.Table(
        SearchSpace(parameters=(SpaceParameter(name="x", keys=("x",)),)), points
    )
    assert {table.outcome({"x": 0.1}, seed).value for seed in range(20)} == {0.9}
    assert {table.outcome({"x": 0.4}, seed).value for seed in range(40)} == {0.1, -0.1, 0.2}
    assert table.outcome({"x": 0.4}, 7) == table.outcome({"x": 0.45}, 7)
    # Of a point that fails once in three flights it is a third that counts.
    assert "8.3 % of the space fails: 1 points at least once, 0 of them" in benchmark.summary(table)
    flown = {point.variant.name: list(point.outcomes) for point in points}
    again = benchmark.missing([point.variant for point in points], flown)
    assert [(one.variant.name, one.repetition) for one in again] == [("t0001", 4), ("t0001", 5)]
    del flown["t0002"]
    (first,) = benchmark.missing([point.variant for point in points], flown)
    assert (first.variant.name, first.repetition) == ("t0002", 1)


@pytest.mark.parametrize("benchmark", ["ros2"], indirect=True)
def test_a_node_answers_every_image_of_the_bench(
    benchmark: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    benchmark.images(40, 40.0, 64, 48)
    assert "40 images of 64x48 at 40 Hz: 0 without an answer\n" in capsys.readouterr().out
