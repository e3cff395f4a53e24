"""The motion capture of a stand-alone embedded vehicle, sent as `wil/mocap/1` by UDP."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from wil_campaign.plugins.mocap.motion_capture import PROTOCOL
from wil_campaign.vehicles.embedded.process.vehicle_faults import VehicleFaults
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.links.link import LinkError
from wil_campaign.vehicles.links.link_strings import LinkAddress
from wil_campaign.vehicles.readings import PoseReading
from wil_campaign.vehicles.readings.copies import restamp_pose

BODY = "drone"


class VehicleMocap:
    """Sends the captured poses of an embedded vehicle to a UDP address, one message a frame.

    With the rate, noise and latency of the vehicle's profile and the faults of `pose_source`, as
    the body `drone`, in NED. Without velocities, as motion capture measures none.
    """

    def __init__(self, address: LinkAddress) -> None:
        self._address = address
        self._seq = 0

    @asynccontextmanager
    async def attach(self, vehicle: EmbeddedVehicle, faults: VehicleFaults) -> AsyncIterator[None]:
        """Send a vehicle's motion capture within the context. Raises LinkError."""
        place = (self._address.host, self._address.port)
        loop = asyncio.get_running_loop()
        try:
            transport, _ = await loop.create_datagram_endpoint(
                asyncio.DatagramProtocol, remote_addr=place
            )
        except OSError as error:
            raise LinkError(f"motion capture to {place[0]}:{place[1]}: {error}") from error

        def send(reading: PoseReading) -> None:
            if not transport.is_closing():
                transport.sendto(self._frame(reading))

        vehicle.on_mocap(faults.through("pose_source", restamp_pose, send))
        try:
            yield
        finally:
            transport.close()

    def _frame(self, reading: PoseReading) -> bytes:
        """Return the message of one frame, as JSON."""
        body = {
            "name": BODY,
            "position_m": reading.pose.position_ned_m,
            "q_wxyz": reading.pose.q_wxyz,
        }
        frame = {
            "protocol": PROTOCOL,
            "seq": self._seq,
            "t_s": reading.t_s,
            "frame": "ned",
            "bodies": [body],
        }
        self._seq += 1
        return json.dumps(frame).encode()
