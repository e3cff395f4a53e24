"""A ground station made with mavsdk's own client; run as a program: URL px4|ardupilot.

Connects, sets a parameter, keeps a fence and a mission, arms, takes off, goes to a place, lands,
lists the logs and fetches one; a line for each, and exit code 0 when all of it worked.
"""

import contextlib
import json
import math
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from mavsdk import ComponentType, Configuration, Mavsdk, System
from mavsdk.plugins.action import Action, ActionError
from mavsdk.plugins.geofence import FenceType, Geofence, GeofenceData, Point, Polygon
from mavsdk.plugins.log_files import LogFiles
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.mission import Mission, MissionItem, MissionPlan
from mavsdk.plugins.mission_raw import MissionRaw
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import Telemetry

FLOATS = {"px4": "COM_OF_LOSS_T", "ardupilot": "GUID_TIMEOUT"}
INTEGERS = {"px4": "GF_ACTION", "ardupilot": "FENCE_ACTION"}
STEP_DEG = 1e-4
UP_M = 3.0


def wait(what: str, condition: Callable[[], bool], within_s: float = 40.0) -> None:
    """Wait for something; raises TimeoutError."""
    end_s = time.monotonic() + within_s
    while not condition():
        if time.monotonic() > end_s:
            raise TimeoutError(what)
        time.sleep(0.05)


def report(text: str) -> None:
    """Tell that something worked."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


class Client:
    """One vehicle by mavsdk."""

    def __init__(self, system: System, autopilot: str) -> None:
        self.autopilot = autopilot
        self.system = system
        self.action, self.telemetry = Action(system), Telemetry(system)
        self.direct = MavlinkDirect(system)

    def parameters(self) -> None:
        """Set one of each type, and read them back."""
        param = Param(self.system)
        param.set_param_float(FLOATS[self.autopilot], 2.5)
        assert param.get_param_float(FLOATS[self.autopilot]) == 2.5
        param.set_param_int(INTEGERS[self.autopilot], 1)
        assert param.get_param_int(INTEGERS[self.autopilot]) == 1
        everything = param.get_all_params()
        names = {one.name for one in (*everything.int_params, *everything.float_params)}
        assert {FLOATS[self.autopilot], INTEGERS[self.autopilot]} <= names
        report(f"parameters {len(names)}")

    def position(self) -> tuple[float, float, float]:
        """Return latitude, longitude and height above home."""
        here = self.telemetry.position()
        return here.latitude_deg, here.longitude_deg, here.relative_altitude_m

    def ready(self) -> None:
        """Wait until it may arm."""
        health = self.telemetry.health
        self.telemetry.set_rate_position(10.0)
        if self.autopilot == "px4":
            wait("ready", lambda: health().is_armable and health().is_home_position_ok)
        wait("position", lambda: math.isfinite(self.position()[0]) and self.position()[0] != 0.0)
        report("ready")

    def fence(self) -> None:
        """Upload a square, and read it back where that can be asked for."""
        latitude, longitude, _ = self.position()
        corners = [
            Point(latitude + n * STEP_DEG, longitude + e * STEP_DEG)
            for n, e in ((9, 9), (9, -9), (-9, -9), (-9, 9))
        ]
        fence = Geofence(self.system)
        fence.upload_geofence(GeofenceData([Polygon(corners, FenceType.INCLUSION)], []))
        back = fence.download_geofence()
        assert len(back.polygons[0].points) == 4
        report("fence")

    def mission(self) -> None:
        """Upload a mission, read it back, and clear it."""
        latitude, longitude, _ = self.position()
        items = [
            MissionItem(
                latitude_deg=latitude + number * STEP_DEG,
                longitude_deg=longitude,
                relative_altitude_m=3.0 + number,
                speed_m_s=math.nan,
                is_fly_through=True,
                gimbal_pitch_deg=math.nan,
                gimbal_yaw_deg=math.nan,
                camera_action=MissionItem.CameraAction.NONE,
                loiter_time_s=math.nan,
                camera_photo_interval_s=0.1,
                acceptance_radius_m=1.0,
                yaw_deg=math.nan,
                camera_photo_distance_m=math.nan,
                vehicle_action=MissionItem.VehicleAction.NONE,
            )
            for number in range(3)
        ]
        mission = Mission(self.system)
        mission.upload_mission(MissionPlan(items))
        if self.autopilot == "px4":
            assert len(mission.download_mission().mission_items) == len(items)
        else:
            # ArduPilot's first item is its home, which the client's Mission cannot read (4.1).
            assert len(MissionRaw(self.system).download_mission()) == len(items)
        mission.clear_mission()
        report("mission")

    def arm(self) -> None:
        """Arm by the command itself: the client's own arm() may abort the process (4.1)."""
        # Commands of ours are not acknowledged here: what is refused is asked for again.
        self.until("armed", self.telemetry.armed, *self.guided(), (400, 1.0))
        report("armed")

    def guided(self) -> tuple[tuple[float, ...], ...]:
        """Return the command for the mode in which ArduPilot takes off; none for PX4."""
        return ((176, 1.0, 4.0),) if self.autopilot == "ardupilot" else ()

    def until(self, what: str, done: Callable[[], bool], *commands: tuple[float, ...]) -> None:
        """Give commands until something is done; each time it is waited for longer.

        A takeoff that is commanded again on the ground begins anew: a vehicle that is short of
        processor time would never leave it.
        """
        for attempt in range(10):
            for number, *parameters in commands:
                self._command(int(number), *parameters)
            with contextlib.suppress(TimeoutError):
                wait(what, done, 1.0 + attempt)
                return
        raise TimeoutError(what)

    def is_up(self) -> bool:
        """Return whether the vehicle has reached its height."""
        return self.position()[2] > UP_M - 0.5

    def fly(self) -> None:
        """Take off, go some metres north, and land."""
        if self.autopilot == "px4":
            self.action.set_takeoff_altitude(UP_M)
            self.action.takeoff()
        else:
            takeoff = (22, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, UP_M)
            # In the air alone is not enough: an early takeoff may end on the ground, disarmed.
            self.until("height", self.is_up, *self.guided(), (400, 1.0), takeoff)
        wait("height", self.is_up)
        report("took off")
        latitude, longitude, _ = self.position()
        amsl_m = self.telemetry.position().absolute_altitude_m
        wanted = latitude + STEP_DEG
        self.action.goto_location(wanted, longitude, amsl_m, 0.0)
        wait("place", lambda: abs(self.position()[0] - wanted) < 0.1 * STEP_DEG)
        report("went north")
        self.action.land()
        wait("disarmed", lambda: not self.telemetry.armed())
        report("landed")

    def logs(self) -> None:
        """List the logs, and fetch the newest."""
        files = LogFiles(self.system)
        newest = files.get_entries()[-1]
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "log"
            done: list[object] = []
            files.download_log_file_async(
                newest, str(file), lambda result, *_: done.append(result), None
            )
            wait("log", lambda: file.exists() and file.stat().st_size == newest.size_bytes)
        report(f"log of {newest.size_bytes} bytes")

    def _command(self, number: int, *parameters: float) -> None:
        fields = {f"param{n + 1}": value for n, value in enumerate(parameters)}
        self.direct.send_message(
            MavlinkMessage(
                "COMMAND_LONG",
                245,
                190,
                self.system.get_system_id(),
                1,
                json.dumps(
                    {
                        "target_system": self.system.get_system_id(),
                        "target_component": 1,
                        "command": number,
                        "confirmation": 0,
                        **dict.fromkeys((f"param{n}" for n in range(1, 8)), 0.0),
                        **fields,
                    }
                ),
            )
        )


def main(url: str, autopilot: str) -> None:
    """Do everything once."""
    ground = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    assert ground.add_any_connection(url) == 0
    system = ground.first_autopilot(20.0)
    if system is None:
        raise TimeoutError("no autopilot")
    report(f"connected to system {system.get_system_id()}")
    client = Client(system, autopilot)
    for step in (
        client.parameters,
        client.ready,
        client.fence,
        client.mission,
        client.arm,
        client.fly,
        client.logs,
    ):
        try:
            step()
        except ActionError as error:
            raise RuntimeError(f"{step.__name__}: {error}") from error


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
