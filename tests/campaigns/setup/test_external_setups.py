"""What a campaign may say of sources and motion capture."""

import math

import pytest

from tests.campaigns.conftest import Files
from wil_campaign.campaigns.setup.case_setup import Case

CAMERA = "camera: {type: camera, rate_hz: 15, width_px: 320, height_px: 240, fov_deg: 69}"
REAL = f"    pose_source: mocap\n    sensors:\n      {CAMERA}\n"
TWIN = f"    autopilot: ardupilot\n    sensors:\n      {CAMERA}\n"
CALIBRATION = """\
schema: wil/calibration/1
camera: {width_px: 320, height_px: 240, fx_px: 250, fy_px: 251, cx_px: 160, cy_px: 119,
         distortion: [-0.1, 0.01, 0, 0, 0]}
mount: {forward_m: 0.1, pitch_deg: -10}
latency_ms: 83
"""


def setup(files: Files) -> Case:
    return files.load().setups["large"]


def with_source(files: Files, source: str, *, of: str = "real", more: str = "") -> None:
    old = REAL if of == "real" else TWIN
    files.change(old, old.replace("fov_deg: 69", f"fov_deg: 69, source: {source}{more}"))


def needs(files: Files) -> list[str]:
    return [name for _, name in setup(files).needing_wall_clock()]


@pytest.mark.parametrize(
    ("source", "kind"),
    [
        ("rtsp://camera.local/main", "rtsp"),
        ("rtp://127.0.0.1:5600", "rtp"),
        ("rtsps://user:p@ss/word@camera:554/a?b=1&c=/d", "rtsp"),
        ("/dev/video0", "v4l2"),
        ("v4l2:///dev/v4l/by-id/usb-a:b_0-index0", "v4l2"),
        ("ipc:///tmp/sim", "simulator"),
        ("tcp://127.0.0.1:5555", "simulator"),
    ],
)
def test_live_sources_need_the_wall_clock(files: Files, source: str, kind: str) -> None:
    with_source(files, f'"{source}"')
    (camera,) = setup(files).vehicles["real"].cameras
    assert camera.source is not None
    assert (camera.source.kind, camera.source.address) == (kind, source)
    assert needs(files) == [f"the camera at {source}"]
    assert camera.source.shown_as == ("rendered" if kind == "simulator" else "live")


@pytest.mark.parametrize(
    ("name", "kind"), [("flight.mp4", "video"), ("images", "images"), ("run.mcap", "mcap")]
)
def test_recordings_are_found_beside_the_campaign_and_fly_on_any_clock(
    files: Files, name: str, kind: str
) -> None:
    path = files.folder / name
    path.mkdir() if kind == "images" else path.touch()
    with_source(files, name)
    (camera,) = setup(files).vehicles["real"].cameras
    assert camera.source is not None
    assert (camera.source.kind, camera.source.address) == (kind, str(path.resolve()))
    assert needs(files) == []
    assert camera.source.shown_as == "file"


def test_a_source_has_its_times(files: Files) -> None:
    with_source(files, "{address: 'rtsp://c/x', latency_ms: 80, stall_s: 3, transport: udp}")
    (camera,) = setup(files).vehicles["real"].cameras
    assert camera.source is not None
    assert (camera.source.latency_s, camera.source.stall_s) == (0.08, 3.0)
    assert camera.source.transport == "udp"


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("none.mp4", "there is no file or folder 'none.mp4' beside the campaign"),
        ("http://camera/x", "the known schemes are rtsp://"),
        ("RTSP://camera/x", "the known schemes are rtsp://"),
        ("rtp://0.0.0.0", "'rtp://0.0.0.0' is not rtp://HOST:PORT, as in rtp://0.0.0.0:5600"),
        ("rtp://camera:99999", "is not rtp://HOST:PORT"),
        ("'rtp://[::1]:5600'", "is not rtp://HOST:PORT"),
        ("'rtsp://'", "is not rtsp://HOST/PATH"),
        ("v4l2://video0", "is not /dev/videoN"),
        ("/dev/", "is not /dev/videoN"),
        ("tcp://127.0.0.1", "is not tcp://HOST:PORT, or ipc://PATH"),
        ("{address: /dev/video0, format: ''}", "must not be empty"),
        ("{address: 'rtp://h:5600', topic: /camera}", "has no effect on a source of rtp"),
        ("{address: 'tcp://h:5600', latency_ms: 9}", "has no effect on a source of simulator"),
        ("{address: '.', topic: /camera}", "has no effect on a source of images"),
        ("{address: campaign.yaml, stall_s: 9}", "has no effect on a source of video"),
        ("{address: 'rtsp://h', transport: quic}", "must be tcp or udp"),
        ("{address: 'rtsp://h', latency: 3}", "unknown key 'latency'"),
        ("{latency_ms: 3}", "missing key 'address'"),
    ],
)
def test_impossible_sources_are_refused(files: Files, source: str, said: str) -> None:
    with_source(files, source)
    faults = files.faults()
    assert any(said in fault for fault in faults)
    assert all(fault.startswith("campaign.yaml:11:") for fault in faults)


def test_a_registered_camera_must_answer_for_a_requested_pose(files: Files) -> None:
    files.change(
        "    filter:", "    transform: [{register: {pose: real}}]\n    filter:", "recipe.yaml"
    )
    with_source(files, "'rtp://127.0.0.1:5600'", of="twin")
    (fault,) = files.faults()
    assert "cannot provide an image from a requested pose" in fault
    files.change("rtp://127.0.0.1:5600", "tcp://127.0.0.1:5600")
    assert setup(files).vehicles["twin"].cameras[0].source is not None


def test_a_calibration_gives_optics_mounting_and_latency(files: Files) -> None:
    (files.folder / "cam.yaml").write_text(CALIBRATION)
    text = REAL.replace("fov_deg: 69", "calibration: cam.yaml, source: 'rtp://127.0.0.1:5600'")
    files.change(REAL, text)
    steps = "    transform: [{camera_model: real}]\n    filter:"
    files.change("    filter:", steps, file="recipe.yaml")
    (camera,) = setup(files).vehicles["real"].cameras
    assert (camera.intrinsics.fx_px, camera.intrinsics.cy_px) == (250.0, 119.0)
    assert camera.intrinsics.distortion == (-0.1, 0.01, 0.0, 0.0, 0.0)
    assert camera.mount.pose.position_ned_m == (0.1, 0.0, 0.0)
    ahead = camera.mount.pose.to_parent((1.0, 0.0, 0.0))
    assert ahead[2] == pytest.approx(math.sin(math.radians(10.0)))
    assert camera.source is not None
    assert camera.source.latency_s == pytest.approx(0.083)


def test_a_value_of_the_campaign_wins_over_the_calibration(files: Files) -> None:
    (files.folder / "cam.yaml").write_text(CALIBRATION)
    more = "{address: 'rtp://h:5600', latency_ms: 5}"
    text = f"calibration: cam.yaml, mount: {{down_m: 0.2}}, source: {more}"
    files.change(REAL, REAL.replace("fov_deg: 69", text))
    steps = "    transform: [{camera_model: real}]\n    filter:"
    files.change("    filter:", steps, file="recipe.yaml")
    (camera,) = setup(files).vehicles["real"].cameras
    assert camera.mount.pose.position_ned_m == (0.0, 0.0, 0.2)
    assert camera.source is not None
    assert camera.source.latency_s == 0.005


@pytest.mark.parametrize(
    ("key", "text", "said"),
    [
        ("calibration: none.yaml", CALIBRATION, "there is no file 'none.yaml'"),
        (
            "calibration: cam.yaml, fov_deg: 69",
            CALIBRATION,
            "the calibration determines this already",
        ),
        (
            "calibration: cam.yaml",
            CALIBRATION.replace("320", "640"),
            "is for 640x240, but the camera has 320x240",
        ),
        ("calibration: cam.yaml", CALIBRATION.replace("fx_px: 250, ", ""), "missing key 'fx_px'"),
    ],
)
def test_calibrations_that_do_not_fit_are_refused(
    files: Files, key: str, text: str, said: str
) -> None:
    (files.folder / "cam.yaml").write_text(text)
    files.change(REAL, REAL.replace("fov_deg: 69", key))
    assert any(said in fault for fault in files.faults())


def test_motion_capture_comes_from_an_address(files: Files) -> None:
    files.change(
        "    pose_source: mocap\n", "    pose_source: mocap\n    mocap: udp://127.0.0.1:5570\n"
    )
    mocap = setup(files).vehicles["real"].mocap
    assert mocap is not None
    assert (mocap.kind, mocap.host, mocap.port, mocap.body) == ("udp", "127.0.0.1", 5570, "real")
    assert needs(files) == ["motion capture at udp://127.0.0.1:5570"]


@pytest.mark.parametrize(
    ("mocap", "said"),
    [
        ("serial://x", "must be udp://HOST:PORT"),
        ("vrpn://10.0.0.1", "VRPN is not read any more: have a bridge of 20 lines send its poses"),
        ("udp://0.0.0.0", "must be udp://HOST:PORT"),
        ("{address: 'udp://127.0.0.1:5570', topic: x}", "applies to tcp:// only"),
        ("{address: 'tcp://127.0.0.1:5570', sender: 127.0.0.1}", "applies to udp:// only"),
        ("{address: 'udp://127.0.0.1:5570', sender: vicon}", "must be an IP address, or IP:PORT"),
        ("{address: 'udp://127.0.0.1:5570', sender: '1.2.3.4:0'}", "must be an IP address"),
    ],
)
def test_impossible_motion_capture_is_refused(files: Files, mocap: str, said: str) -> None:
    files.change("    pose_source: mocap\n", f"    pose_source: mocap\n    mocap: {mocap}\n")
    assert any(said in fault for fault in files.faults())


def test_unused_motion_capture_is_refused(files: Files) -> None:
    files.change("    pose_source: mocap\n", "    mocap: udp://127.0.0.1:5570\n")
    assert any("is not used with pose_source: mavlink" in fault for fault in files.faults())
