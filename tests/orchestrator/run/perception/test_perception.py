"""Whole flights with recipes of all kinds: every sensor, each budget, steps that fail."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.conftest import SMALL_CAMERAS
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.orchestrator.recording.run_video import make_video
from wil_campaign.orchestrator.run.perception import warm_up
from wil_campaign.orchestrator.run_results.run_result import CombinationResult, RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.plugins.offline.replay import replay_mixing
from wil_campaign.plugins.python.mcap_reader import (
    RecordedProvenance,
    RecordedReading,
    Recording,
)
from wil_campaign.vehicles.autonomy import Command, Telemetry
from wil_campaign.vehicles.readings import CameraReading, Reading, sensor_type_of
from wil_campaign.vehicles.setpoints import VelocitySetpoint

Fly = Callable[..., tuple[RunResult, Path]]
ROOT = Path(__file__).parents[4]

SENSORS = {
    "depth": "{type: depth, rate_hz: 10, width_px: 64, height_px: 48, fov_deg: 69}",
    "scan": "{type: lidar, beams: 60}",
    "points": "{type: lidar_points, columns: 90, rings: 4, rate_hz: 5}",
    "range": "{type: rangefinder}",
    "gps": "{type: gps}",
    "pose": "{type: pose}",
    "imu": "{type: imu, rate_hz: 100}",
    "sound": "{type: microphone}",
}
CARRIED = tuple(
    f"vehicles.{vehicle}.sensors.{name}={what}"
    for vehicle in ("real", "twin")
    for name, what in SENSORS.items()
)
ALL = """\
schema: wil/recipe/1
sensors:
  camera: {type: camera, rate_hz: 15}
  depth: {type: depth}
  scan: {type: lidar, rate_hz: 5}
  points: {type: lidar_points}
  range: {type: rangefinder}
  gps: {type: gps}
  pose: {type: pose}
  imu: {type: imu}
  sound: {type: microphone}
combine:
  - sensor: camera
    transform: [register]
    filter: [{isolate_color: orange}]
    merge: overlay
    publish: [real]
  - sensor: camera
    transform: [register]
    filter: [{isolate_objects: [gate]}]
    merge: overlay
    publish: [twin]
    publish_raw: true
  - {sensor: depth, transform: [register], merge: {aggregate: min}, publish: [real]}
  - {sensor: scan, transform: [register], merge: {aggregate: min}}
  - {sensor: points, transform: [register], merge: concatenate}
  - {sensor: range, transform: [register], merge: {aggregate: min}}
  - {sensor: gps, transform: [{resample: interpolate}], merge: {aggregate: mean}}
  - {sensor: pose, transform: [{delay: 50}], merge: {aggregate: mean}}
  - {sensor: imu, transform: [{resample: interpolate}], merge: {aggregate: mean}}
  - {sensor: sound, merge: add}
"""
SMALLEST = tuple(
    f"vehicles.{vehicle}.sensors.camera.{key}={value}"
    for vehicle in ("real", "twin")
    for key, value in (("width_px", 160), ("height_px", 120))
)
"""Where nobody looks for anything in the pictures."""
GATE = """\
schema: wil/recipe/1
sensors: {camera: {type: camera, rate_hz: 15}}
combine:
  - sensor: camera
    transform: [{register: {pose: real, align: ALIGN}}]
    filter: [{isolate_color: {name: orange}}]
    merge: overlay
    max_skew_ms: SKEW
"""


class Listening:
    """Flies nowhere for a second, and keeps what it was told."""

    made: list["Listening"]

    def __init__(self, **_: object) -> None:
        self.heard: list[Reading] = []
        self.raw: list[Reading] = []
        self.since_s: float | None = None
        Listening.made.append(self)

    def perceive(self, reading: Reading) -> None:
        self.heard.append(reading)

    def perceive_raw(self, reading: Reading) -> None:
        self.raw.append(reading)

    def act(self, telemetry: Telemetry) -> Command:
        self.since_s = self.since_s or telemetry.t_s
        done = telemetry.t_s - self.since_s > 1.0
        return Command(VelocitySetpoint((0.0, 0.0, 0.0)), done=done)


@pytest.fixture
def listening(monkeypatch: pytest.MonkeyPatch) -> list[Listening]:
    Listening.made = []
    monkeypatch.setattr(
        "wil_campaign.campaigns.setup.autonomy_under_test.find_autonomy", lambda *_: Listening
    )
    return Listening.made


def recipe(folder: Path, text: str) -> str:
    path = folder / "recipe.yaml"
    path.write_text(text)
    return f"recipe={path}"


def flown(made: list[Listening]) -> list[Listening]:
    """Return those that flew: some are made to see whether they can be."""
    return [one for one in made if one.heard]


def knows_nothing(reading: Any) -> bool:
    names = ("object_ids", "camera_pose")
    beside = reading.depth_m is not None if sensor_type_of(reading) == "camera" else False
    return not beside and all(getattr(reading, name, None) is None for name in names)


def test_every_sensor_is_mixed_delivered_and_recorded(
    fly_run: Fly, tmp_path: Path, listening: list[Listening]
) -> None:
    free = ("vehicles.twin.coupling=free", "goal.altitude_m=0.5")
    result, folder = fly_run(
        cameras=SMALL_CAMERAS, sets=(*CARRIED, *SMALLEST, *free, recipe(tmp_path, ALL))
    )
    assert result.mixing is not None
    combined = {one.name: one for one in result.mixing.combinations}
    names = ["depth", "scan", "points", "range", "gps", "pose", "imu", "sound"]
    assert list(combined) == ["camera.real", "camera.twin", *names]
    assert [one.sensor for one in result.mixing.combinations[1:4]] == ["camera", "depth", "lidar"]
    assert result.mixing.frames == combined["camera.real"].frames
    for name, rate_hz in {"camera.real": 15, "scan": 5, "gps": 5, "imu": 100}.items():
        assert combined[name].rate_hz == pytest.approx(rate_hz, rel=0.05)
    spoilt = {name for name, one in combined.items() if one.dropped}
    assert spoilt <= {"points", "pose"}  # before the takeoff is over: too near, or too early
    assert not any(event.verdict == "INVALID" for event in result.also)
    assert all(one.registration_error_px is not None for one in list(combined.values())[:3])

    for_real, for_twin = flown(listening)
    kinds = Counter(sensor_type_of(reading) for reading in for_real.heard)
    assert set(kinds) == {"camera", "depth", *(_type_of(name) for name in names[1:])}
    assert {reading.source for reading in for_real.heard} == {"mixed"}
    assert {reading.sensor for reading in for_real.heard} == {"camera", *names}
    # The twin gets no mixture of the depth camera, so it perceives its own.
    assert {r.source for r in for_twin.heard if r.sensor == "depth"} == {"twin"}
    assert {r.source for r in for_twin.heard if r.sensor != "depth"} == {"mixed"}
    assert for_real.raw == []
    assert {(r.sensor, r.source) for r in for_twin.raw} == {("camera", "real"), ("camera", "twin")}
    assert all(knows_nothing(r) for one in (for_real, for_twin) for r in (*one.heard, *one.raw))

    written: Counter[str] = Counter()
    asked: list[int] = []
    for item in Recording(folder / "run.mcap"):
        if isinstance(item, RecordedReading):
            written[f"{item.reading.source} {item.sensor}"] += 1
            if (item.reading.source, item.sensor) == ("twin", "camera"):
                asked.append(item.reading.seq)
        elif isinstance(item, RecordedProvenance):
            written[f"provenance {item.sensor}"] += 1
    for name, one in combined.items():
        assert written[f"mixed {name}"] == one.frames
        assert written[f"provenance {name}"] >= one.frames
    assert written["real camera"] == combined["camera.real"].frames
    assert written["twin camera"] == 2 * combined["camera.real"].frames  # each mixture asks
    assert written["twin gps"] >= combined["gps"].frames
    assert len(asked) == len(set(asked))


class Painting(Listening):
    """Paints over every image that it is given."""

    def perceive(self, reading: Reading) -> None:
        if isinstance(reading, CameraReading):
            self.heard.append(replace(reading, image_bgr=reading.image_bgr.copy()))
            reading.image_bgr[:] = 255


def test_an_autonomy_that_paints_on_its_images_changes_no_others(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded: list[list[bytes]] = []
    for kind in (Listening, Painting):
        Listening.made = []
        monkeypatch.setattr(
            "wil_campaign.campaigns.setup.autonomy_under_test.find_autonomy",
            lambda *_, kind=kind: kind,
        )
        _, folder = fly_run(sets=("vehicles.twin.coupling=free", "goal.altitude_m=0.5"))
        perceived = [one for one in flown(Listening.made) if one.heard]
        assert len(perceived) == 2
        images = [
            each for one in perceived for each in one.heard if isinstance(each, CameraReading)
        ]
        assert not any((image.image_bgr == 255).all() for image in images)
        recorded.append(
            [
                item.reading.image_bgr.tobytes()
                for item in Recording(folder / "run.mcap")
                if isinstance(item, RecordedReading) and isinstance(item.reading, CameraReading)
            ]
        )
    plain, painted = recorded
    assert len(plain) > 10
    assert painted == plain


def _type_of(name: str) -> str:
    return SENSORS[name].removeprefix("{type: ").split(",", maxsplit=1)[0].rstrip("}")


def combination(result: RunResult) -> CombinationResult:
    assert result.mixing is not None
    return result.mixing.combinations[0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            GATE.replace("ALIGN", "hold").replace("SKEW", "1"),
            "mixing of camera: exposures ",
        ),
        (
            GATE.replace("ALIGN", "interpolate").replace(
                "SKEW", "60\n    max_registration_error_px: 0.01"
            ),
            "mixing of camera: max_registration_error_px: ",
        ),
    ],
    ids=["skew", "registration"],
)
def test_mixing_that_leaves_its_budget_makes_a_run_invalid(
    fly_run: Fly, tmp_path: Path, listening: list[Listening], text: str, said: str
) -> None:
    result, _ = fly_run(cameras=SMALL_CAMERAS, sets=(recipe(tmp_path, text),))
    assert result.verdict == "INVALID"
    assert result.reason.startswith(said)
    if "hold" in text:
        # An overlay beyond its budget is not drawn, and counted.
        assert sum(combination(result).dropped.values()) > 0


def test_an_object_of_other_cases_isolates_nothing(
    fly_run: Fly, tmp_path: Path, listening: list[Listening]
) -> None:
    text = GATE.replace("ALIGN", "interpolate").replace("SKEW", "60")
    text = text.replace("{isolate_color: {name: orange}}", "{isolate_objects: [gate, guest]}")
    guest = (
        "world.objects.guest={shape: {box: {size_m: [1, 1, 1]}}, pose: {north_m: 2, up_m: 0.5},"
        " exists_in: {sim: none, wil: none, real: none}}"
    )
    sets = (*SMALLEST, guest, recipe(tmp_path, text), "goal.altitude_m=0.5")
    result, folder = fly_run(cameras=SMALL_CAMERAS, sets=sets)
    assert result.verdict != "ERROR", result.reason
    assert combination(result).frames > 0
    report = replay_mixing(folder)
    assert report.compared == combination(result).frames
    assert not report.diverges


def test_an_exception_in_the_users_step_is_an_error_with_its_place(
    fly_run: Fly, tmp_path: Path, listening: list[Listening]
) -> None:
    (tmp_path / "mine.py").write_text(
        "class Fragile:\n"
        "    def __init__(self):\n        self.frames = 0\n"
        "    def __call__(self, work, other):\n"
        "        self.frames += 1\n"
        "        return work if self.frames < 20 else {}['nothing']\n"
    )
    text = GATE.replace("ALIGN", "interpolate").replace("SKEW", "60")
    text = text.replace("{isolate_color: {name: orange}}", "{use: 'mine.py:Fragile'}")
    result, _ = fly_run(cameras=SMALL_CAMERAS, sets=(recipe(tmp_path, text),))
    assert result.verdict == "ERROR"
    where = f"{tmp_path / 'recipe.yaml'}:6: step mine.py:Fragile, frame 19: "
    assert result.reason == f"{where}KeyError: 'nothing' (mine.py line 6)"


def test_a_step_of_the_users_that_cannot_be_made_is_an_error_too(
    fly_run: Fly, tmp_path: Path, listening: list[Listening]
) -> None:
    (tmp_path / "mine.py").write_text(
        "class Never:\n"
        "    def __init__(self):\n        raise OSError('no model here')\n"
        "    def __call__(self, work, other):\n        return work\n"
    )
    text = GATE.replace("ALIGN", "interpolate").replace("SKEW", "60")
    text = text.replace("{isolate_color: {name: orange}}", "{use: 'mine.py:Never'}")
    result, _ = fly_run(cameras=SMALL_CAMERAS, sets=(recipe(tmp_path, text),))
    assert result.verdict == "ERROR"
    assert "recipe.yaml:6: step mine.py:Never, frame 0: OSError: no model here" in result.reason


def test_a_vehicle_alone_perceives_all_its_own_sensors(
    fly_run: Fly, listening: list[Listening]
) -> None:
    result, folder = fly_run(
        mode="sim", cameras=SMALL_CAMERAS, sets=(*CARRIED, *SMALLEST, "goal.altitude_m=0.5")
    )
    assert result.mixing is None
    (alone,) = flown(listening)
    assert {reading.sensor for reading in alone.heard} == {"camera", *SENSORS}
    assert {reading.source for reading in alone.heard} == {"twin"}
    assert all(knows_nothing(reading) for reading in alone.heard)
    assert make_video(folder)
    assert (folder / "mixed.mp4").is_file()


@pytest.mark.parametrize("sets", [(), CARRIED])
def test_the_search_in_clouds_is_imported_before_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sets: tuple[str, ...]
) -> None:
    searched: list[int] = []
    place = "wil_campaign.plugins.lidar.visibility.nearest_point_distances_m"
    monkeypatch.setattr(place, lambda points, _: searched.append(len(points)))
    options = ExpansionOptions(cases=("large",), modes=("sim",), sets=sets)
    plan = load_campaign(ROOT / "campaigns" / "gate.yaml", options).runs[0]
    warm_up.warm_up(RunSetup.of(RunOrder(plan=plan, folder=tmp_path, clock="virtual")))
    assert searched == ([1] if sets else [])


def test_a_recipe_that_wants_more_than_its_source_gives_is_refused(tmp_path: Path) -> None:
    text = GATE.replace("ALIGN", "hold").replace("SKEW", "60").replace("rate_hz: 15", "rate_hz: 30")
    with pytest.raises(BadInput, match="the real vehicle's 'camera' has a rate of 15 Hz"):
        load_campaign(
            ROOT / "campaigns" / "gate.yaml", ExpansionOptions(sets=(recipe(tmp_path, text),))
        )
