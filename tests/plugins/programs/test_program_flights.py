"""Whole flights of autonomies that are programs of the user's."""

import json
import sys
import textwrap
from pathlib import Path

from tests.orchestrator.external.test_external_flights import sets
from tests.orchestrator.wall_runs import SHORT, Program
from tests.ports import free_port

FLY = """
    import json, os, socket, sys, time
    import msgpack, zmq
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    host, port = os.environ["WIL_MAVLINK_URL"].removeprefix("udpout://").split(":")
    goal, system = json.loads(os.environ["WIL_GOAL"]), int(os.environ["WIL_SYSTEM_ID"])
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.settimeout(0.05)
    mav, parser = mavlink.MAVLink(None, srcSystem=200), mavlink.MAVLink(None)
    parser.robust_parsing = True
    moved = armed = 0
    print("flying to", goal["altitude_m"], flush=True)
    lidar, seen = zmq.Context().socket(zmq.SUB), []
    for scans in json.loads(os.environ.get("WIL_ZMQ", "[]")):
        lidar.connect(scans["address"])
        lidar.subscribe(scans["topic"])
    while True:
        link.sendto(mavlink.MAVLink_set_position_target_local_ned_message(
            0, system, 1, 1, 0b110111000111, 0, 0, 0, 0.5, 0, 0, 0, 0, 0, 0, 0
        ).pack(mav), (host, int(port)))
        until = time.monotonic() + 0.05
        while time.monotonic() < until:
            try:
                data = link.recv(2048)
            except TimeoutError:
                break
            for message in parser.parse_buffer(data) or []:
                if message.get_type() == "LOCAL_POSITION_NED" and message.get_srcSystem() != 200:
                    moved = message.x
        while lidar.poll(0):
            seen.append(msgpack.unpackb(lidar.recv_multipart()[1]))
        if moved > 1.0:
            print("there", len(seen) > 5, *(one["type"] for one in seen[-1:]), flush=True)
            sys.exit(0)
"""


async def test_an_autonomy_that_is_a_program_flies(tmp_path: Path) -> None:
    script = tmp_path / "fly.py"
    script.write_text(textwrap.dedent(FLY))
    command = json.dumps([sys.executable, str(script)])
    given = (
        *sets(f"autonomy={{program: {command}}}", "vehicles.twin.start={north_m: 0}"),
        # A second camera, whose images are not for its one stream.
        *sets(
            "vehicles.twin.sensors.down={type: camera, rate_hz: 5, width_px: 80, height_px: 60, "
            "fov_deg: 69}"
        ),
        *sets(
            "vehicles.twin.sensors.scan={type: lidar, rate_hz: 10, beams: 60}",
            "deliver=[{zmq: 'tcp://127.0.0.1:*', sensor: scan, vehicle: twin}]",
        ),
        *sets(
            "oracles={time_limit: {limit_s: 60}, landed: {}, vehicle_fault: {}, "
            "reached: {required: false}}",
            "controls={}",
        ),
    )
    async with Program(tmp_path / "out", "--mode", "sim", "--json", *given) as program:
        landed = await program.end()
    assert landed.code == 0, landed.why
    (run,) = json.loads(landed.out)["runs"]
    assert (run["verdict"], run["reason"]) == ("PASS", "")
    (result,) = run["outside"]["programs"]
    assert result["exit"] == "ended by itself, exit code 0"
    assert result["refused"] > 0  # it flew before it was its turn
    assert result["video"]["failed"] == 0
    assert result["video"]["delivered"] > 20
    log = (program.run_folder("sim") / "twin-autonomy.log").read_text()
    assert log == "flying to 1.2\nthere True lidar\n"


CROPPED = """
    schema: wil/recipe/1
    sensors: {camera: {type: camera, rate_hz: 10}}
    combine:
      - sensor: camera
        transform: [register, {crop: {width_px: 120, height_px: 90, on: both}}]
        filter: [{isolate_color: {name: orange}}]
        merge: overlay
"""


async def test_a_program_is_sent_mixtures_of_the_size_that_the_recipe_gives_them(
    tmp_path: Path,
) -> None:
    script, recipe = tmp_path / "fly.py", tmp_path / "recipe.yaml"
    script.write_text(textwrap.dedent(FLY))
    recipe.write_text(textwrap.dedent(CROPPED))
    command = json.dumps([sys.executable, str(script)])
    given = (
        *(*SHORT, *sets(f"autonomy={{program: {command}}}", f"recipe={recipe}")),
        *sets(f"deliver=[{{rtp: '127.0.0.1:{free_port()}'}}]"),
    )
    async with Program(tmp_path / "out", "--mode", "wil", "--json", *given) as program:
        landed = await program.end()
    assert landed.code == 0, landed.why
    (run,) = json.loads(landed.out)["runs"]
    videos = {one["vehicle"]: one["video"] for one in run["outside"]["programs"]}
    assert set(videos) == {"real"}
    (outlet,) = run["outside"]["outlets"]
    sent = (videos["real"], outlet)
    assert all(one["failed"] == 0 and one["delivered"] > 20 for one in sent)
