"""Motion capture over VRPN, where a client library is installed. Wall clock only.

The library is the Python binding that VRPN itself builds (module `vrpn`); it is on no package
index, so it is imported only when a VRPN capture is opened.
"""

import asyncio
import contextlib
import importlib
import threading
from collections.abc import Callable
from datetime import datetime
from typing import Any, Self

from vehicles.readings import PoseReading
from vehicles.sources.camera_source import SourceError
from vehicles.sources.mocap.motion_capture import (
    BodyPose,
    CaptureFrame,
    MotionCapture,
    pose_from_enu,
)
from worlds.frames import quat_normalize

_POLL_S = 0.001


class VrpnCapture:
    """Motion capture of one tracker of a VRPN server; an async context manager.

    host: of the server, with `:PORT` if not 3883. tracker: its name there, and the body's name in
    `capture`. Trackers are taken to be z-up (ENU, FLU), as Vicon, OptiTrack and Qualisys serve
    them. fail: called in the loop with the error that ended the capture; nothing is delivered
    afterwards.
    """

    def __init__(
        self,
        *,
        host: str,
        tracker: str,
        capture: MotionCapture,
        deliver: Callable[[PoseReading], None],
        fail: Callable[[SourceError], None],
    ) -> None:
        self.name = f"VRPN tracker {tracker}@{host}"
        self._address = f"{tracker}@{host}"
        self._body = tracker
        self._capture = capture
        self._deliver = deliver
        self._fail = fail
        self._stop = threading.Event()
        self._seq = -1

    async def __aenter__(self) -> Self:
        """Connect to the VRPN server. Raises SourceError without a client library."""
        self._loop = asyncio.get_running_loop()
        try:
            vrpn: Any = importlib.import_module("vrpn")
        except ImportError as error:
            raise SourceError(
                f"{self.name}: no VRPN client library is installed; build VRPN with its Python "
                "binding (module `vrpn`), or send the documented UDP message instead "
                "(docs/motion-capture.md)"
            ) from error
        self._tracker = vrpn.receiver.Tracker(self._address)
        self._tracker.register_change_handler(None, self._on_change, "position")
        self._thread = threading.Thread(target=self._run, name=self.name, daemon=True)
        self._thread.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Disconnect from the VRPN server; nothing is delivered afterwards."""
        self._stop.set()
        await asyncio.to_thread(self._thread.join, 1.0)

    def _run(self) -> None:
        try:
            while not self._stop.wait(_POLL_S):
                self._tracker.mainloop()
        except Exception as cause:  # noqa: BLE001 - a thread's error must reach the reader
            if self._stop.is_set():
                return
            error = SourceError(
                f"{self.name}: the VRPN library failed: {type(cause).__name__}: {cause}; check the "
                "VRPN server and the network to it"
            )
            error.__cause__ = cause
            with contextlib.suppress(RuntimeError):  # the loop is closed: nobody reads
                self._loop.call_soon_threadsafe(self._fail, error)

    def _on_change(self, _userdata: object, report: dict[str, Any]) -> None:
        self._loop.call_soon_threadsafe(self._take_report, report, self._loop.time())

    def _take_report(self, report: dict[str, Any], arrived_s: float) -> None:
        if self._stop.is_set():
            return
        self._seq += 1
        stamp_s = _seconds(report["time"], arrived_s)
        frame = CaptureFrame(self._seq, stamp_s, (self._body_pose(report),))
        for reading in self._capture.take_frame(frame, arrived_s):
            self._deliver(reading)

    def _body_pose(self, report: dict[str, Any]) -> BodyPose:
        px, py, pz = (float(number) for number in report["position"])
        x, y, z, w = (float(number) for number in report["quaternion"])
        try:
            q = quat_normalize((w, x, y, z))
        except ValueError:
            return BodyPose(self._body, None)
        return BodyPose(self._body, pose_from_enu((px, py, pz), q))


def _seconds(stamp: object, arrived_s: float) -> float:
    """Return a VRPN stamp in seconds; the arrival without one."""
    if isinstance(stamp, datetime):
        return stamp.timestamp()
    return float(stamp) if isinstance(stamp, int | float) else arrived_s
