"""Bench files: their faults with places, and which bench a campaign is flown on, with what."""

from pathlib import Path
from typing import Any

import pytest

from tests.campaigns.conftest import Files
from wil_campaign.campaigns.schema.bench import BenchRequestPart
from wil_campaign.campaigns.setup.bench_file import Bench, load_benches, read_bench
from wil_campaign.campaigns.setup.bench_resolution import fitting_benches
from wil_campaign.foundation.files.documents import BadInput, parse_document
from wil_campaign.vehicles.links.link_strings import parse_link

BENCH = """\
schema: wil/bench/1
bench: hall-a
properties: {indoor: true, net_m: 6}
vehicles:
  real:
    link: udpin://127.0.0.1:14540
    autopilot: px4
    sensors:
      camera: {type: camera, rate_hz: 15, width_px: 320, height_px: 240, fov_deg: 69}
geofence:
  box: {north_m: [-1, 4], east_m: [-2, 2], up_m: [-0.5, 2.3]}
arming: {users: [anna]}
"""
GEOFENCE = "geofence:\n  box: {north_m: [-1, 4], east_m: [-2, 2], up_m: [-0.5, 2.3]}\n"


def bench_of(text: str, name: str = "hall-a.yaml") -> Bench:
    return read_bench(parse_document(text.encode(), name=name))


def faults_of(text: str) -> list[str]:
    with pytest.raises(BadInput) as caught:
        bench_of(text)
    return [problem.headline for problem in caught.value.problems]


@pytest.fixture
def asking(files: Files) -> Files:
    """The small campaign, its real vehicle and its fence left to a bench."""
    text = files.path.read_text()
    real = text[text.index("  real:") : text.index("  twin:")]
    files.change(real, "  real:\n    start: {north_m: 0.5}\n")
    files.change(GEOFENCE, "bench: hall-a\n")
    return files


def test_the_bench_of_the_page_is_one(tmp_path: Path) -> None:
    page = (Path(__file__).parents[3] / "docs" / "bench.md").read_text("utf-8")
    path = tmp_path / "hall-a.yaml"
    path.write_text(page.partition("```yaml\n")[2].partition("```")[0])
    (tmp_path / "camera.yaml").write_text(
        "schema: wil/calibration/1\n"
        "camera: {width_px: 640, height_px: 480, fx_px: 520, fy_px: 515, cx_px: 330, cy_px: 236}\n"
    )
    assert [bench.name for bench in load_benches([path])] == ["hall-a"]


def test_a_bench_has_its_properties_and_the_autopilot_of_its_vehicle() -> None:
    bench = bench_of(BENCH)
    assert bench.facts.properties == {"indoor": True, "net_m": 6, "autopilot": "px4"}
    assert bench.vehicle.attached == parse_link("udpin://127.0.0.1:14540")
    assert str(bench.facts) == "hall-a (autopilot: px4, indoor: true, net_m: 6)"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("bench: hall-a", "bench: hall a", "hall-a.yaml:2:8: "),
        ("udpin://127.0.0.1:14540", "embedded", "hall-a.yaml:6:11: must be a link such as udpin"),
        ("udpin://127.0.0.1:14540", "udpin://14540", "hall-a.yaml:6:11: must be embedded, a link"),
        ("indoor: true", "autopilot: px4", "hall-a.yaml:3:25: is that of vehicles.real already"),
        ("indoor: true", "indoor: [1]", "hall-a.yaml:3:22: "),
        (GEOFENCE, "", "hall-a.yaml:1:1: missing key 'geofence'"),
        ("up_m: [-0.5, 2.3]", "up_m: [2.3, -0.5]", "hall-a.yaml:11:"),
        ("users: [anna]", "users: []", "hall-a.yaml:12:17: "),
        ("arming:", "arm:", "hall-a.yaml:12:1: "),
        ("fov_deg: 69", "calibration: none.yaml", "hall-a.yaml:9:"),
    ],
)
def test_a_fault_of_a_bench_file_has_its_place(old: str, new: str, said: str) -> None:
    assert BENCH.count(old) == 1
    found = faults_of(BENCH.replace(old, new))
    assert any(one.startswith(said) for one in found), found


def test_two_benches_of_one_name_are_refused_with_both_places(tmp_path: Path) -> None:
    one, other = tmp_path / "a.yaml", tmp_path / "b.yaml"
    for path in (one, other):
        path.write_text(BENCH)
    with pytest.raises(BadInput) as caught:
        load_benches((one, other))
    (problem,) = caught.value.problems
    assert problem.headline.startswith(f"{other}:2:8: {one}:2:8 is another bench named 'hall-a'")


def test_a_campaign_takes_vehicle_and_fence_of_its_bench(asking: Files) -> None:
    campaign = asking.load(benches=(bench_of(BENCH),))
    assert [bench.name for bench in campaign.benches] == ["hall-a"]
    for setup in campaign.setups.values():
        real = setup.vehicles["real"]
        assert real.attached == parse_link("udpin://127.0.0.1:14540")
        assert [sensor.name for sensor in real.sensors] == ["camera"]
        assert real.start.position_ned_m[0] == 0.5  # of the campaign, beside keys of the bench
        assert set(setup.fences) == {"real", "twin"}
    flown = campaign.runs[0].setup()
    assert flown.vehicles == setup.vehicles


@pytest.mark.parametrize(
    ("options", "left_out"),
    [
        ({}, ()),
        ({"repetitions": 1}, ("2 of 3 repetitions",)),
        (
            {"sets": ("modes=[sim]", "accept={large: {sim: 3/3}}")},
            ("large/wil", "the control low/wil"),
        ),
        (
            {"sets": ("oracles={reached: {}, collision: {}, geofence: }",)},
            ("the oracle time_limit",),
        ),
        ({"sets": ("controls={}",)}, ("the control low/sim", "the control low/wil")),
    ],
)
def test_required_runs_that_options_omit_on_a_bench_are_named(
    asking: Files, options: dict[str, Any], left_out: tuple[str, ...]
) -> None:
    asking.append("controls:\n  low: {set: {goal.altitude_m: 1.0}, expect: {oracle: reached}}\n")
    assert asking.load(benches=(bench_of(BENCH),), **options).left_out == left_out


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "start: {north_m: 0.5}",
            "link: embedded",
            "vehicles.real.link is defined by bench hall-a (hall-a.yaml:6:5); remove it here",
        ),
        (
            "large: {}",
            "large: {vehicles.real.autopilot: ardupilot}",
            "vehicles.real.autopilot is defined by bench hall-a (hall-a.yaml:7:5); remove it here",
        ),
        (
            "bench: hall-a\n",
            f"bench: hall-a\n{GEOFENCE}",
            "geofence is defined by bench hall-a (hall-a.yaml:10:1); remove it here",
        ),
        ("large: {}", "large: {bench: hall-b}", "'bench' is the same for all cases"),
    ],
)
def test_a_key_that_the_bench_defines_is_refused_in_the_campaign(
    asking: Files, old: str, new: str, said: str
) -> None:
    asking.change(old, new)
    faults = asking.faults(benches=(bench_of(BENCH),))
    assert any(fault.endswith(said) and fault.startswith("campaign.yaml:") for fault in faults), (
        faults
    )


@pytest.mark.parametrize(
    ("asked", "at", "said"),
    [
        ("hall-b", "hall-b", "there is no bench 'hall-b'; there is hall-a (autopilot: px4"),
        ("{name: hall-b}", "hall-b", "there is no bench 'hall-b'"),
        ("{properties: {indor: true}}", "indor", "no bench has the property 'indor'"),
        ("{properties: {indoor: 1}}", "1}", "no bench has indoor: 1; there is hall-a"),
        ("{name: hall-a, properties: {net_m: 8}}", "8}", "no bench has net_m: 8"),
        ("{wait_s: 5}", "{wait", "give the name of a bench, or properties"),
        ("{name: hall-a, wait_s: soon}", "soon", "must be a number"),
    ],
)
def test_a_bench_that_is_not_there_is_named_at_its_place(
    asking: Files, asked: str, at: str, said: str
) -> None:
    asking.change("bench: hall-a", f"bench: {asked}")
    written = f"bench: {asked}"
    line = asking.path.read_text().splitlines().index(written) + 1
    (fault,) = asking.faults(benches=(bench_of(BENCH),))
    assert fault.startswith(f"campaign.yaml:{line}:{written.index(at) + 1}: {said}"), fault


def test_a_missing_bench_and_a_needless_one_are_reported(files: Files, asking: Files) -> None:
    (missing,) = asking.faults()
    assert "asks for a bench: give the file of one" in missing
    asking.change("bench: hall-a\n", "")
    (unasked,) = asking.faults(benches=(bench_of(BENCH),))
    assert "asks for no bench, but --bench-file gives hall-a; write `bench: hall-a`" in unasked


def test_properties_choose_among_benches() -> None:
    inside = bench_of(BENCH)
    outside = bench_of(BENCH.replace("hall-a", "field").replace("indoor: true", "indoor: false"))
    benches = (inside.facts, outside.facts)

    def fitting(**asked: bool | float | str) -> list[str]:
        request = BenchRequestPart(properties=asked)
        return [bench.name for bench in fitting_benches(request, benches)]

    assert fitting(indoor=True) == ["hall-a"]
    assert fitting(indoor=False) == ["field"]
    assert fitting(net_m=6.0, autopilot="px4") == ["hall-a", "field"]
    assert fitting(indoor=True, autopilot="ardupilot") == []


def test_files_of_a_bench_stand_beside_the_bench_file(asking: Files, tmp_path: Path) -> None:
    hall = tmp_path / "hall"
    hall.mkdir()
    (hall / "fence.geojson").write_text(
        '{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": '
        "[[[8.4999, 47.3999], [8.5001, 47.3999], [8.5001, 47.4001], [8.4999, 47.4001], "
        "[8.4999, 47.3999]]]}}"
    )
    text = BENCH.replace("  box: {north_m: [-1, 4], east_m: [-2, 2], up_m: [-0.5, 2.3]}", "%s")
    (hall / "hall-a.yaml").write_text(text % "  {file: fence.geojson, up_m: [-0.5, 2.3]}")
    campaign = asking.load(benches=load_benches((hall / "hall-a.yaml",)))
    assert hall / "fence.geojson" in campaign.paths
    assert hall / "hall-a.yaml" in campaign.paths
