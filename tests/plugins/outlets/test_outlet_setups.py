"""What a campaign may say of deliveries and of a ground station."""

import pytest

from tests.campaigns.conftest import Files
from tests.campaigns.setup.test_external_setups import CAMERA, REAL, needs, setup
from wil_campaign.plugins.outlets.outlet_setups import (
    DeliverySetups,
    GroundStationSetup,
    ImageOutlet,
)


def test_outlets_that_need_the_wall_clock_are_named_with_their_place() -> None:
    outlets = tuple(
        ImageOutlet(kind="rtp", address=f"127.0.0.1:{port}", sensor="camera") for port in (1, 2)
    )
    assert list(DeliverySetups(outlets).needing_wall_clock()) == [
        (("deliver", 0), "rtp 127.0.0.1:1"),
        (("deliver", 1), "rtp 127.0.0.1:2"),
    ]
    assert list(GroundStationSetup("udp:127.0.0.1:14550").needing_wall_clock()) == [
        (("ground_station",), "a ground station at udp:127.0.0.1:14550")
    ]


def test_deliveries_are_read_with_the_one_camera_there_is(files: Files) -> None:
    files.append("deliver: [{rtp: '127.0.0.1:5600'}, {zmq: 'tcp://*:5601', of: twin}]\n")
    files.change("tcp://*:5601", "tcp://127.0.0.1:5601")
    given = setup(files).observers["deliver"]
    assert isinstance(given, DeliverySetups)
    first, second = given.outlets
    assert (first.kind, first.address, first.sensor, first.of) == (
        "rtp",
        "127.0.0.1:5600",
        "camera",
        "perceived",
    )
    assert (second.of, second.encoding) == ("twin", "bgr8")
    assert needs(files) == ["rtp 127.0.0.1:5600", "zmq tcp://127.0.0.1:5601"]


def test_any_sensor_is_delivered_by_zmq_at_free_ports(files: Files) -> None:
    files.change(REAL, f"{REAL}      scan: {{type: lidar, rate_hz: 5}}\n")
    files.append(
        "deliver: [{zmq: 'tcp://127.0.0.1:*', sensor: scan, of: real},"
        " {zmq: 'tcp://127.0.0.1:*', sensor: camera}]\n"
    )
    given = setup(files).observers["deliver"]
    assert isinstance(given, DeliverySetups)
    assert [outlet.sensor for outlet in given.outlets] == ["scan", "camera"]


@pytest.mark.parametrize(
    ("deliver", "said"),
    [
        ("{sensor: camera}", "give one of rtp, zmq, v4l2"),
        ("{rtp: '127.0.0.1:5600', zmq: 'tcp://127.0.0.1:5601'}", "give one of"),
        ("{rtp: '127.0.0.1:5601'}", "RTP needs an even port"),
        ("{rtp: here}", "must be HOST:PORT"),
        ("{v4l2: video10}", "must be a loopback device"),
        ("{zmq: '127.0.0.1:5601'}", "must be an address to bind"),
        ("{rtp: '127.0.0.1:5600', encoding: png}", "is for zmq, not for rtp"),
        ("{rtp: '127.0.0.1:5600', sensor: camara}", "has no camera 'camara'"),
        ("{rtp: '127.0.0.1:5600', sensor: scan}", "delivers images, and 'scan' is no camera; use"),
        ("{zmq: 'tcp://127.0.0.1:*', sensor: scam}", "has no sensor 'scam'"),
        ("{zmq: 'tcp://127.0.0.1:1'}, {zmq: 'tcp://127.0.0.1:1'}", "is already used by delivery 1"),
        ("{rtp: '127.0.0.1:5600', of: real, vehicle: twin}", "has no effect with of: real"),
        ("{rtp: '127.0.0.1:5600'}, {rtp: '127.0.0.1:5600'}", "is already used by delivery 1"),
    ],
)
def test_impossible_deliveries_are_refused(files: Files, deliver: str, said: str) -> None:
    files.change(REAL, f"{REAL}      scan: {{type: lidar, rate_hz: 5}}\n")
    files.append(f"deliver: [{deliver}]\n")
    assert any(said in fault for fault in files.faults())


def test_where_there_are_several_cameras_a_delivery_names_one(files: Files) -> None:
    files.change(REAL, f"{REAL}      second: {CAMERA.partition(': ')[2]}\n")
    files.append("deliver: [{rtp: '127.0.0.1:5600'}]\n")
    assert any("name the camera by" in fault for fault in files.faults())


def test_a_ground_station_is_a_link_that_leads_out(files: Files) -> None:
    files.append("ground_station: udpout://127.0.0.1:14550\n")
    assert needs(files) == ["a ground station at udpout://127.0.0.1:14550"]
    files.change("udpout://127.0.0.1:14550", "udpin://0.0.0.0:14550")
    assert any("must be outgoing" in fault for fault in files.faults())
