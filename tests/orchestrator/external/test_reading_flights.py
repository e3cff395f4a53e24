"""Whole flights whose real sensors are what the vehicle itself sends by MAVLink; spoiled, too."""

import asyncio
import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import msgpack  # type: ignore[import-untyped]  # ships no types
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.orchestrator.flights import all_landed
from tests.orchestrator.recording.ros2_bag import write_bag
from wil_campaign.campaigns.values.external_setups import ReadingSourceSetup
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.python.mcap_reader import RecordedReading, Recording
from wil_campaign.plugins.readings import reading_sources
from wil_campaign.plugins.readings.messagepack import BadMessageError
from wil_campaign.plugins.readings.reading_message import PROTOCOL
from wil_campaign.plugins.readings.topic_readings import TopicReadings
from wil_campaign.plugins.readings.zmq_readings import ZmqReadings
from wil_campaign.vehicles.embedded.autopilot.px4.px4_core import Px4Core
from wil_campaign.vehicles.readings import (
    DepthReading,
    ImuReading,
    LidarScanReading,
    PoseReading,
    RangefinderReading,
    Reading,
)
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.worlds.frames import Pose

Fly = Callable[..., tuple[RunResult, Path]]
Builder = Callable[[Any], Any]
Spoil = Callable[[Any, float], Any]

RANGE, IMU = mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR, mavlink.MAVLINK_MSG_ID_HIGHRES_IMU
FIX = mavlink.MAVLINK_MSG_ID_GPS_RAW_INT
AHEAD = (
    "autonomy={use: autonomies/straight.py:StraightAutonomy, with: {speed_m_s: 0.8, for_s: 4}}",
    "goal.altitude_m=0.5",
    "oracles.reached.required=false",
    "oracles.collision.required=false",
)
"""Up, 3 m ahead, and down: long enough for a silence to be noticed."""


MERGES = {"rangefinder": "by: min", "lidar": "by: min", "gps": "by: mean", "imu": "by: mean"}


def mixed(folder: Path, **real: str) -> tuple[str, ...]:
    """Sensors of both vehicles that a recipe mixes; real: keys of the real vehicle's, by type."""
    recipe = folder / "recipe.yaml"
    lines = ["schema: wil/recipe/1", "sensors:"]
    lines += [f"  {kind}: {{type: {kind}}}" for kind in real]
    lines += ["combine:"]
    for kind in real:
        merge = f"{{aggregate: {{{MERGES[kind]}}}}}"
        lines += [f"  - {{sensor: {kind}, merge: {merge}, publish: [real, twin]}}"]
    recipe.write_text("\n".join(lines))
    twins = ", ".join(f"{kind}: {{type: {kind}, rate_hz: 20}}" for kind in real)
    reals = ", ".join(
        f"{kind}: {{type: {kind}, rate_hz: 20, {keys}}}" for kind, keys in real.items()
    )
    return (
        f"vehicles.real.sensors={{{reals}}}",
        f"vehicles.twin.sensors={{{twins}}}",
        f"recipe={recipe}",
        *AHEAD,
    )


def spoil(patch: pytest.MonkeyPatch, message: int, how: Spoil) -> None:
    """Have the embedded PX4's message changed by `how`, which gets its time since boot."""
    build: Builder = Px4Core.builders[message]
    patch.setitem(Px4Core.builders, message, lambda s: how(build(s), s.boot_ms * 1e-3))


def readings(folder: Path) -> list[Reading]:
    """All readings that a run recorded."""
    items = Recording(folder / "run.mcap")
    return [one.reading for one in items if isinstance(one, RecordedReading)]


def walls(s: Any) -> Any:
    """An OBSTACLE_DISTANCE: 72 sectors of 5 degrees, ahead first; walls 9 m ahead, 3 m aside."""
    distances = [1201] * 72
    distances[0], distances[18] = round(900 - 100 * s.now.position_ned_m[0]), 300
    return mavlink.MAVLink_obstacle_distance_message(
        s.boot_us, 0, distances, 5, 20, 1200, 0.0, 0.0, mavlink.MAV_FRAME_BODY_FRD
    )


def test_sensors_that_the_vehicle_sends_are_mixed_as_any(fly_run: Fly, tmp_path: Path) -> None:
    given = dict.fromkeys(("rangefinder", "imu", "gps"), "source: mavlink")
    result, folder = fly_run(sets=mixed(tmp_path, **given), has_cameras=False)
    assert result.verdict == "PASS", result.reason
    assert result.outside is not None
    assert {source.sensor for source in result.outside.sources} == set(given)
    for source in result.outside.sources:
        assert (source.vehicle, source.source, source.damaged, source.stalls) == (
            "real",
            "live",
            0,
            0,
        )
        assert source.delivered > 100
    assert result.mixing is not None
    assert result.mixing.frames > 100
    assert all_landed(folder)
    felt = [reading for reading in readings(folder) if isinstance(reading, ImuReading)]
    down = [one.specific_force_frd_m_s2[2] for one in felt if one.source == "real"]
    assert sum(down) / len(down) == pytest.approx(-9.8, abs=0.5)


def test_a_lidar_has_the_distances_of_the_autopilot_s_sectors(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(Px4Core.builders, mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, walls)
    lidar = "{type: lidar, rate_hz: 10, beams: 72, source: mavlink}"
    pose = "{type: pose, rate_hz: 20, source: mavlink}"
    sets = (
        f"vehicles.real.sensors={{lidar: {lidar}, pose: {pose}}}",
        "modes=[real]",
        "accept={large: {real: 5/5}}",
    )
    result, folder = fly_run(mode="real", sets=(*sets, *AHEAD), has_cameras=False)
    assert result.verdict == "PASS", result.reason
    assert result.outside is not None
    assert [source.delivered > 50 for source in result.outside.sources] == [True, True]
    scans = [reading for reading in readings(folder) if isinstance(reading, LidarScanReading)]
    assert {float(scan.ranges_m[54]) for scan in scans} == {3.0}, "90 degrees to the right"
    assert all(math.isinf(scan.ranges_m[0]) for scan in scans), "behind"
    assert max(scan.ranges_m[36] for scan in scans) - min(scan.ranges_m[36] for scan in scans) > 2.0
    heights = [
        -reading.pose.position_ned_m[2]
        for reading in readings(folder)
        if type(reading) is PoseReading
    ]
    assert max(heights) == pytest.approx(0.5, abs=0.2)


def test_an_ardupilot_sends_mg_and_mrad(fly_run: Fly, tmp_path: Path) -> None:
    sets = mixed(tmp_path, imu="source: mavlink", gps="source: mavlink")
    result, folder = fly_run("gate-ardupilot", sets=sets, has_cameras=False)
    assert result.verdict == "PASS", result.reason
    felt = [reading for reading in readings(folder) if isinstance(reading, ImuReading)]
    down = [one.specific_force_frd_m_s2[2] for one in felt if one.source == "real"]
    assert sum(down) / len(down) == pytest.approx(-9.8, abs=0.5)


def later(message: Any, **changes: float) -> Any:
    for name, value in changes.items():
        setattr(message, name, value)
    return message


SPOILED: dict[str, tuple[str, int, Spoil, str]] = {
    "stops": ("imu", IMU, lambda m, _: None, "no HIGHRES_IMU for 1 s"),
    "is no number": ("imu", IMU, lambda m, _: later(m, zacc=math.nan), "was refused"),
    "is of another clock": (
        "imu",
        IMU,
        lambda m, _: later(m, time_usec=m.time_usec + 7_000_000),
        "after its arrival",
    ),
    "is old": (
        "gps",
        FIX,
        lambda m, _: later(m, time_usec=max(1, m.time_usec - 7_000_000)),
        "before its arrival",
    ),
    "turns in degrees": (
        "imu",
        IMU,
        lambda m, _: later(m, **{f"{x}gyro": math.degrees(getattr(m, f"{x}gyro")) for x in "xyz"}),
        "their unit is wrong (rad/s is expected)",
    ),
    "freezes": (
        "gps",
        FIX,
        lambda m, _: later(m, lat=473979000, lon=85461000, alt_ellipsoid=488_000),
        "the sensor is frozen",
    ),
}


@pytest.mark.parametrize("what", SPOILED)
def test_a_sensor_that_is_spoiled_in_flight_proves_nothing(
    fly_run: Fly, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    kind, message, how, said = SPOILED[what]
    build: Builder = Px4Core.builders[message]

    def built(s: Any) -> Any:
        made = build(s)
        return how(made, s.boot_ms * 1e-3) if s.now.position_ned_m[2] < -0.3 else made

    monkeypatch.setitem(Px4Core.builders, message, built)
    sets = mixed(tmp_path, **{kind: "source: mavlink"})
    result, folder = fly_run(sets=sets, has_cameras=False)
    assert result.verdict == "INVALID", result.reason
    assert result.reason.count(f"real {kind}") == 1
    assert said in result.reason
    assert all_landed(folder)


REFUSED: dict[str, tuple[str, int, Spoil, str]] = {
    "in g": (
        "imu",
        IMU,
        lambda m, _: later(m, xacc=m.xacc / 9.8, yacc=m.yacc / 9.8, zacc=m.zacc / 9.8),
        "its unit is wrong",
    ),
    "up for down": ("imu", IMU, lambda m, _: later(m, zacc=-m.zacc), "not forward, right, down"),
    "elsewhere": ("gps", FIX, lambda m, _: later(m, lat=m.lat // 10), "beside"),
    "without a fix": ("gps", FIX, lambda m, _: later(m, fix_type=1), "no 3-D fix"),
    "aside": ("rangefinder", RANGE, lambda m, _: later(m, orientation=0), "correct `mount`"),
    "never": ("rangefinder", RANGE, lambda m, _: None, "no usable DISTANCE_SENSOR"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_sensor_that_is_wrong_from_the_start_is_refused_before_arming(
    fly_run: Fly, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    kind, message, how, said = REFUSED[what]
    spoil(monkeypatch, message, how)
    result, _ = fly_run(sets=mixed(tmp_path, **{kind: "source: mavlink"}), has_cameras=False)
    assert result.verdict == "ERROR"
    assert said in result.reason
    assert f"real {kind} from mavlink" in result.reason
    assert result.duration_s is None, "it never armed"


def test_a_recording_is_flown_by_and_is_an_error_when_it_ends_in_flight(
    fly_run: Fly, tmp_path: Path
) -> None:
    own = ("modes=[real]", "accept={large: {real: 5/5}}", *AHEAD)
    below = "type: rangefinder, rate_hz: 20"
    result, recorded = fly_run(
        mode="real", sets=(*own, f"vehicles.real.sensors={{below: {{{below}}}}}"), has_cameras=False
    )
    assert result.verdict == "PASS", result.reason
    file = recorded / "run.mcap"
    given = f"vehicles.real.sensors={{below: {{{below}, source: {{address: {file}}}}}}}"
    result, folder = fly_run(mode="real", sets=(*own, given), has_cameras=False)
    assert result.verdict == "PASS", result.reason
    assert result.outside is not None
    (one,) = result.outside.sources
    assert (one.source, one.stalls, one.damaged) == ("file", 0, 0)
    assert one.delivered > 100
    first, second = (readings(here)[:50] for here in (recorded, folder))
    assert [ranges_of(one) for one in first] == [ranges_of(one) for one in second]
    longer = "autonomy.with={speed_m_s: 0.1, for_s: 30}"
    result, folder = fly_run(mode="real", sets=(*own, longer, given), has_cameras=False)
    assert result.verdict == "ERROR"
    assert "the recording is over" in result.reason
    assert all_landed(folder)
    for kind, topic, said in (
        ("rangefinder", "/real/ahead", "no topic '/real/ahead' (available: /real/below)"),
        ("gps", "/real/below", "has readings of type rangefinder, but the sensor is a gps"),
        ("gps", None, "set `topic` to the readings of type gps to use (available: none)"),
    ):
        with pytest.raises(SourceError) as caught:
            opened(TopicReadings(path=file, kind=kind, topic=topic))
        assert said in str(caught.value)


def test_a_bag_of_ros_2_is_flown_by(fly_run: Fly, tmp_path: Path) -> None:
    distance = {"radiation_type": 0, "field_of_view": 0.1, "variance": 0.0, "range": 1.5}
    limits = {"min_range": 0.25, "max_range": 8.0}
    bag = [
        ("/below", "sensor_msgs/msg/Range", 100.0 + k / 20, {**distance, **limits})
        for k in range(1200)
    ]
    file = write_bag(tmp_path / "bag.mcap", bag)
    below = f"type: rangefinder, rate_hz: 20, source: {{address: {file}, topic: /below}}"
    own = ("modes=[real]", "accept={large: {real: 5/5}}", *AHEAD)
    sets = (*own, f"vehicles.real.sensors={{below: {{{below}}}}}")
    result, folder = fly_run(mode="real", sets=sets, has_cameras=False)
    assert result.verdict == "PASS", result.reason
    assert result.outside is not None
    (one,) = result.outside.sources
    assert (one.source, one.damaged) == ("file", 0)
    assert one.delivered > 100
    assert {ranges_of(reading) for reading in readings(folder)} == {1.5}


def opened(file: TopicReadings) -> Reading | None:
    """The first reading of a recording."""
    file.open()
    return file.next()


def ranges_of(reading: Reading) -> float:
    assert isinstance(reading, RangefinderReading)
    return reading.range_m


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_text("nothing of the kind")
    with pytest.raises(SourceError, match="not an MCAP file"):
        opened(TopicReadings(path=path, kind="gps", topic=None))
    with pytest.raises(SourceError, match="check the path"):
        opened(TopicReadings(path=tmp_path / "none.mcap", kind="gps", topic="/real/gps"))


WIDTH, HEIGHT = 64, 48
DEPTH_KEYS = f"type: depth, rate_hz: 10, width_px: {WIDTH}, height_px: {HEIGHT}, fov_deg: 70"
SIGHTED = '''\
from wil_campaign.campaigns.autonomies.straight import StraightAutonomy


class Sighted(StraightAutonomy):
    """Flies ahead; fails where it was given no depth image."""

    seen = 0

    def perceive(self, reading):
        self.seen += reading.sensor == "depth" and float(reading.depth_m.min()) <= 2.5

    def act(self, telemetry):
        command = super().act(telemetry)
        if command.done and not self.seen:
            raise RuntimeError("no depth was perceived")
        return command
'''


def depth_flight(folder: Path, source: str) -> tuple[str, ...]:
    """A depth camera of both vehicles, mixed by the lesser distance, for an autonomy."""
    recipe, autonomy = folder / "recipe.yaml", folder / "sighted.py"
    autonomy.write_text(SIGHTED)
    recipe.write_text(
        "schema: wil/recipe/1\nsensors: {depth: {type: depth}}\ncombine:\n"
        "  - {sensor: depth, merge: {aggregate: {by: min}}, publish: [real, twin]}\n"
    )
    return (
        f"vehicles.real.sensors={{depth: {{{DEPTH_KEYS}, source: {source}}}}}",
        f"vehicles.twin.sensors={{depth: {{{DEPTH_KEYS}}}}}",
        f"recipe={recipe}",
        f"autonomy={{use: '{autonomy}:Sighted', with: {{speed_m_s: 0.8, for_s: 4}}}}",
        *AHEAD[1:],
    )


def depth_bag(folder: Path, seconds: float = 90.0) -> Path:
    """A bag of ROS 2 with depth images at 10 Hz: a wall 2.5 m ahead that comes a little nearer."""
    values = np.full((HEIGHT, WIDTH), 2500, "<u2")
    values[:10] = 0
    images = []
    for k in range(int(10 * seconds)):
        values[20, 20] = 2500 - k
        fields = {"height": HEIGHT, "width": WIDTH, "encoding": "16UC1", "is_bigendian": 0}
        data = values.tobytes()
        fields |= {"step": 2 * WIDTH, "data": data}
        images.append(("/depth", "sensor_msgs/msg/Image", 100.0 + 0.1 * k, fields))
    return write_bag(folder / "depth.mcap", images)


def test_recorded_depth_is_mixed_perceived_recorded_and_read_back(
    fly_run: Fly, tmp_path: Path
) -> None:
    sets = depth_flight(tmp_path, str(depth_bag(tmp_path)))
    result, folder = fly_run(sets=sets, has_cameras=False)
    assert result.verdict == "PASS", result.reason
    assert all_landed(folder)
    assert result.outside is not None
    (source,) = result.outside.sources
    assert (source.sensor, source.source, source.damaged) == ("depth", "file", 0)
    there = [reading for reading in readings(folder) if isinstance(reading, DepthReading)]
    reals, mixtures = ([one for one in there if one.source == name] for name in ("real", "mixed"))
    assert len(reals) > 50
    assert len(mixtures) > 50
    for real in reals:
        assert real.rendered is False
        assert real.depth_m[40, 40] == pytest.approx(2.5)
        assert math.isinf(real.depth_m[0, 0])
    assert all((mixture.depth_m <= 2.5 + 1e-6)[20:].all() for mixture in mixtures), (
        "the lesser distance"
    )
    assert any((mixture.depth_m < 2.0).any() for mixture in mixtures), "of the twin's world as well"
    # The recording is a source itself.
    mount = Pose((0.1, 0.0, 0.0))
    file = TopicReadings(
        path=folder / "run.mcap",
        kind="depth",
        topic="/real/depth",
        mount=mount,
        camera=reals[0].intrinsics,
    )
    file.open()
    again: list[Any] = list(iter(file.next, None))
    assert len(again) == len(reals)
    assert {one.mount for one in again} == {mount}, "that of the sensor which it is now"
    assert all(np.array_equal(a.depth_m, b.depth_m) for a, b in zip(again, reals, strict=True))


class FakeDepth(ZmqReadings):
    """A program that publishes depth, in virtual time. spoil: changes a message."""

    spoil: Callable[[dict[str, Any]], dict[str, Any] | None]

    async def __aenter__(self) -> Self:
        self._sending = asyncio.create_task(self._send())
        return self

    async def __aexit__(self, *_: object) -> None:
        self._sending.cancel()

    async def _send(self) -> None:
        loop, values = asyncio.get_running_loop(), np.full((HEIGHT, WIDTH), 2.5, "<f4")
        for seq in itertools.count():
            values[20, 20] = 2.5 - 1e-4 * seq
            camera = {"width_px": WIDTH, "height_px": HEIGHT}
            head = {"protocol": PROTOCOL, "sensor": "depth", "type": "depth", "seq": seq}
            now_s = loop.time()
            given = {**head, "t_s": now_s, "camera": camera, "depth_m": values.tobytes()}
            made = type(self).spoil(given)
            if made is not None:
                try:
                    self.receive(msgpack.packb(made), now_s)
                except BadMessageError as error:
                    self.refuse(str(error))
            await asyncio.sleep(0.1)


FLAT = np.full((HEIGHT, WIDTH), 2.5, "<f4")
SIZE = {"width_px": HEIGHT, "height_px": WIDTH}
DEPTH_SPOILED: dict[str, tuple[dict[str, Any] | None, str, str]] = {
    "silent": (None, "INVALID", "no depth reading for 1 s"),
    "frozen": ({"depth_m": FLAT.tobytes()}, "INVALID", "the sensor is frozen"),
    "not a number": ({"depth_m": (FLAT * np.nan).tobytes()}, "INVALID", "values are not a number"),
    "another size": ({"camera": SIZE}, "INVALID", "the depth image is 48x64"),
    "millimetres from the start": ({"depth_m": (FLAT * 1000).tobytes()}, "ERROR", "unit is wrong"),
    "another size from the start": ({"camera": SIZE}, "ERROR", "the depth image is 48x64"),
}


@pytest.mark.parametrize("what", DEPTH_SPOILED)
def test_depth_that_is_spoiled_proves_nothing(
    fly_run: Fly, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    changes, verdict, said = DEPTH_SPOILED[what]
    flown = [0.0]
    core = Px4Core.builders[mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION]

    def build(s: Any) -> Any:
        flown[0] = min(flown[0], s.now.position_ned_m[2])
        return core(s)

    def spoil_depth(given: dict[str, Any]) -> dict[str, Any] | None:
        if flown[0] > -0.1 and "start" not in what:
            return given
        return None if changes is None else given | changes

    monkeypatch.setitem(Px4Core.builders, mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, build)
    monkeypatch.setattr(FakeDepth, "spoil", staticmethod(spoil_depth), raising=False)
    monkeypatch.setattr(reading_sources, "ZmqReadings", FakeDepth)
    monkeypatch.setattr(ReadingSourceSetup, "needs_wall_clock", property(lambda _: False))
    sets = (*depth_flight(tmp_path, "tcp://127.0.0.1:5580"), "goal.altitude_m=1")
    result, folder = fly_run(sets=sets, has_cameras=False)
    assert result.verdict == verdict, result.reason
    assert said in result.reason
    assert all_landed(folder) or verdict == "ERROR"
