"""A script as people write them with pymavlink's mavutil; run as a program: URL px4|ardupilot.

Connects, lists and sets parameters, keeps a fence and a mission, arms, takes off, goes to a place,
lands, lists the logs; a line for each, and exit code 0 when all of it worked.
"""

import os
import sys
import time
from collections.abc import Callable
from typing import Any

os.environ["MAVLINK20"] = "1"
from pymavlink import mavparm, mavutil, mavwp

FLOATS = {"px4": "COM_OF_LOSS_T", "ardupilot": "GUID_TIMEOUT"}
MAV = mavutil.mavlink
STEP_DEG = 1e-4
UP_M = 3.0
WITHIN_S = 40.0


def report(text: str) -> None:
    """Tell that something worked."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def connection(url: str) -> Any:
    """Connect, once somebody listens there."""
    end_s = time.monotonic() + WITHIN_S
    while True:
        try:
            return mavutil.mavlink_connection(url, source_system=254, retries=0)
        except ConnectionRefusedError:
            if time.monotonic() > end_s:
                raise
            time.sleep(0.25)


class Client:
    """One vehicle by mavutil."""

    def __init__(self, url: str, autopilot: str) -> None:
        self.autopilot = autopilot
        self.link: Any = connection(url)
        heartbeat = self.link.wait_heartbeat(timeout=WITHIN_S)
        assert heartbeat is not None
        report(f"connected to system {self.link.target_system}")

    def until(self, what: str, condition: Callable[[], bool]) -> None:
        """Hear the vehicle until something holds; raises TimeoutError."""
        end_s = time.monotonic() + WITHIN_S
        beat_s = 0.0
        while not condition():
            if time.monotonic() > end_s:
                raise TimeoutError(what)
            if time.monotonic() - beat_s > 0.5:
                beat_s = time.monotonic()
                self.link.mav.heartbeat_send(MAV.MAV_TYPE_GCS, MAV.MAV_AUTOPILOT_INVALID, 0, 0, 4)
            self.link.recv_match(blocking=True, timeout=0.1)

    def answer(self, *kinds: str) -> Any:
        """Return the next message of such a kind; raises TimeoutError."""
        found = self.link.recv_match(type=list(kinds), blocking=True, timeout=WITHIN_S)
        if found is None:
            raise TimeoutError(" or ".join(kinds))
        return found

    def command(self, number: int, *parameters: float) -> None:
        """Send a command until it is accepted."""
        fields = (*parameters, *[0.0] * (7 - len(parameters)))
        where = (self.link.target_system, self.link.target_component)
        for _ in range(40):
            self.link.mav.command_long_send(*where, number, 0, *fields)
            result = self.result(number)
            if result == MAV.MAV_RESULT_ACCEPTED:
                return
            time.sleep(0.25)
        raise TimeoutError(f"command {number}: {result}")

    def result(self, number: int) -> int | None:
        """Return what became of a command; None when nothing is heard of it for two seconds."""
        while ack := self.link.recv_match(type="COMMAND_ACK", blocking=True, timeout=2.0):
            if ack.command == number:
                return int(ack.result)
        return None

    def parameters(self) -> None:
        """Fetch all, set one by the tools' own class."""
        self.link.param_fetch_all()
        first = self.answer("PARAM_VALUE")
        names = {first.param_id}
        while len(names) < first.param_count:
            names.add(self.answer("PARAM_VALUE").param_id)
        name = FLOATS[self.autopilot]
        assert name in names
        assert mavparm.MAVParmDict().mavset(self.link, name, 2.5, retries=5)
        report(f"parameters {len(names)}")

    def ready(self) -> None:
        """Ask for positions, and wait for one and for the checks before arming."""
        for message in (MAV.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, MAV.MAVLINK_MSG_ID_SYS_STATUS):
            self.command(MAV.MAV_CMD_SET_MESSAGE_INTERVAL, message, 100_000)

        def may_arm() -> bool:
            status = self.link.messages.get("SYS_STATUS")
            place = self.link.messages.get("GLOBAL_POSITION_INT")
            healthy = status is not None and bool(
                status.onboard_control_sensors_health & MAV.MAV_SYS_STATUS_PREARM_CHECK
            )
            return healthy and place is not None and place.lat != 0

        self.until("ready", may_arm)
        report("ready")

    def guided(self) -> bool:
        """Ask for GUIDED; return whether it is."""
        self.link.set_mode("GUIDED")
        return bool(self.link.flightmode == "GUIDED")

    def place(self) -> tuple[float, float, float]:
        """Return latitude, longitude and height above home, the last that came."""
        last = self.link.messages["GLOBAL_POSITION_INT"]
        return last.lat / 1e7, last.lon / 1e7, last.relative_alt / 1e3

    def fence_and_mission(self) -> None:
        """Upload both with the tools' loader, read both back, clear the mission."""
        latitude, longitude, _ = self.place()
        inclusion = MAV.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
        corners = [(inclusion, 4, n, e) for n, e in ((9, 9), (9, -9), (-9, -9), (-9, 9))]
        waypoints = [(MAV.MAV_CMD_NAV_WAYPOINT, 0, n, 0) for n in range(4)]
        for kind, name, wanted in ((1, "fence", corners), (0, "mission", waypoints)):
            loader = mavwp.MissionItemProtocol_Fence() if kind else mavwp.MAVWPLoader()
            items = [
                MAV.MAVLink_mission_item_int_message(
                    *(self.link.target_system, self.link.target_component, number),
                    *(MAV.MAV_FRAME_GLOBAL_INT if kind else MAV.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,),
                    *(command, 0, 1, first, 0, 0, 0),
                    *(
                        round((latitude + n * STEP_DEG) * 1e7),
                        round((longitude + e * STEP_DEG) * 1e7),
                    ),
                    *(0.0 if kind else UP_M, kind),
                )
                for number, (command, first, n, e) in enumerate(wanted)
            ]
            for item in items:
                loader.add(item)
            self.upload(loader, kind)
            assert self.count(kind) == len(items)
            report(name)
        self.link.mav.mission_clear_all_send(self.link.target_system, self.link.target_component, 0)
        assert self.answer("MISSION_ACK").type == MAV.MAV_MISSION_ACCEPTED

    def upload(self, loader: Any, kind: int) -> None:
        """Give items away as they are asked for."""
        where = (self.link.target_system, self.link.target_component)
        self.link.mav.mission_count_send(*where, loader.count(), kind)
        while True:
            asked = self.answer("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")
            if asked.get_type() == "MISSION_ACK":
                assert asked.type == MAV.MAV_MISSION_ACCEPTED, asked
                return
            self.link.mav.send(loader.item(asked.seq))

    def count(self, kind: int) -> int:
        """Return how many items there are."""
        self.link.mav.mission_request_list_send(
            self.link.target_system, self.link.target_component, kind
        )
        count = int(self.answer("MISSION_COUNT").count)
        # PX4 takes nothing else for 5 s unless the list's reader is done with it.
        where = (self.link.target_system, self.link.target_component)
        self.link.mav.mission_ack_send(*where, MAV.MAV_MISSION_ACCEPTED, kind)
        return count

    def fly(self) -> None:
        """Arm, take off, go some metres north, and land."""
        if self.autopilot == "ardupilot":
            # Refused until the estimator uses GPS: the pre-arm bit is true before that.
            self.until("guided", self.guided)
        amsl_m = self.link.messages["GLOBAL_POSITION_INT"].alt / 1e3
        self.command(MAV.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        self.until("armed", self.link.motors_armed)
        nan = float("nan")
        height_m = UP_M if self.autopilot == "ardupilot" else amsl_m + UP_M
        free = 0.0 if self.autopilot == "ardupilot" else nan
        self.command(MAV.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, free, free, free, height_m)
        self.until("height", lambda: self.place()[2] > UP_M - 0.5)
        report("took off")
        latitude, longitude, _ = self.place()
        wanted = latitude + STEP_DEG
        self.link.mav.command_int_send(
            *(self.link.target_system, self.link.target_component),
            *(MAV.MAV_FRAME_GLOBAL, MAV.MAV_CMD_DO_REPOSITION, 0, 0, -1, 1, 0, nan),
            *(round(wanted * 1e7), round(longitude * 1e7), amsl_m + UP_M),
        )
        self.until("place", lambda: abs(self.place()[0] - wanted) < 0.1 * STEP_DEG)
        report("went north")
        self.command(MAV.MAV_CMD_NAV_LAND, 0, 0, 0, nan, nan, nan, 0)
        self.until("disarmed", lambda: not self.link.motors_armed())
        report("landed")

    def logs(self) -> None:
        """List the logs."""
        self.link.mav.log_request_list_send(
            self.link.target_system, self.link.target_component, 0, 0xFFFF
        )
        entry = self.answer("LOG_ENTRY")
        assert entry.num_logs >= 1
        report(f"logs {entry.num_logs}")


def main(url: str, autopilot: str) -> None:
    """Do everything once."""
    client = Client(url, autopilot)
    client.parameters()
    client.ready()
    client.fence_and_mission()
    client.fly()
    client.logs()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
