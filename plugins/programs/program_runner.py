"""Runs an autonomy that is a user's program on a vehicle: its link, its video, its end."""

import asyncio
import os
import socket
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Self, cast

from wil_campaign.campaigns.setup.autonomy_under_test import UnderTest
from wil_campaign.campaigns.values.sensor_setups import CameraSetup
from wil_campaign.foundation.processes.supervisor import supervised_command
from wil_campaign.foundation.tasks import start_task, stop_tasks
from wil_campaign.orchestrator.run.perception.foreign_runner import ForeignRunner
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.run_results.result_parts import ProgramResult
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.plugins.outlets.perceived_cameras import perceived_cameras
from wil_campaign.plugins.outlets.rtp import rtp_delivery
from wil_campaign.plugins.outlets.sdp import RtpAddress
from wil_campaign.plugins.programs.autonomy_program import (
    ExternalAutonomy,
    ProgramExit,
    autonomy_environment,
)
from wil_campaign.plugins.programs.command_filter import SETPOINTS, CommandFilter
from wil_campaign.plugins.programs.program_autonomy import ProgramAutonomy
from wil_campaign.plugins.programs.program_video import ProgramVideo
from wil_campaign.safety.model.verdict import DecisiveKind
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.links.link_strings import LinkAddress
from wil_campaign.vehicles.links.tapped import TappedLink
from wil_campaign.vehicles.links.udp import UdpLink
from wil_campaign.vehicles.mavlink.framing import FrameSplitter
from wil_campaign.vehicles.readings import Reading

_HOST = "127.0.0.1"
_GRACE_S = 2.0
"""Shorter than the time that the supervisor itself has to end."""
_POLL_S = 0.25
"""How often a program's memory is measured."""


class ProgramRunner(ForeignRunner):
    """Runs one autonomy program on one vehicle during the run; an async context manager.

    It speaks MAVLink on its own UDP port, and receives what the vehicle perceives as an RTP stream:
    the images of `camera`, which has their size and rate. Where too few of them can be sent while
    the goal is flown, the run is INVALID, as a blind program proves nothing.
    Its setpoints are passed from the goal on; it is done when it ends with exit code 0. Any other
    end is a FAIL of the run, like the crash of any autonomy; an ERROR before its goal. Wall
    clock only.
    """

    def __init__(
        self,
        *,
        under_test: UnderTest,
        program: ProgramAutonomy,
        context: VehicleContext,
        link: TappedLink,
        target: MavlinkTarget,
        camera: CameraSetup | None,
        run_state: RunState,
        folder: Path,
        seed: int,
    ) -> None:
        self.context = context
        self._under_test = under_test
        self._command = program.command
        self._link = link
        self._camera = camera
        self._run_state = run_state
        self._folder = folder
        self._seed = seed
        self._target = target
        self._gate = CommandFilter(target=target)
        self._splitter = FrameSplitter()
        self._udp = UdpLink(address=LinkAddress(kind="udpin", host=_HOST, port=0))
        self._video: ProgramVideo | None = None
        self._is_blind = False
        self._program: ExternalAutonomy | None = None
        self._ending: asyncio.Task[ProgramExit] | None = None
        self._started: Callable[[str, float], None] | None = None
        self._stack = AsyncExitStack()
        self.done = asyncio.Event()

    async def __aenter__(self) -> Self:
        """Open the program's ports and start it. Raises VehicleError."""
        async with AsyncExitStack() as stack:
            self._udp.receive(self._pass_frames)
            self._link.tap(self._on_frame)
            await stack.enter_async_context(self._udp)
            sdp = self._folder / f"{self.context.name}-perceived.sdp"
            if self._camera is not None:
                self._video = _video(self._camera, sdp)
                await stack.enter_async_context(self._video.delivery)
            self._program = ExternalAutonomy(
                command=supervised_command(self._command, parent=os.getpid(), grace_s=_GRACE_S),
                environment=self._environment(sdp if self._video is not None else None),
                log_path=self._folder / f"{self.context.name}-autonomy.log",
                folder=self._under_test.folder,
            )
            await stack.enter_async_context(self._program)
            self._ending = start_task(self._program.ended(), name="program's end")
            self._ending.add_done_callback(self._on_program_end)
            watching = start_task(self._watch(self._program), name="program's memory and video")
            stack.push_async_callback(stop_tasks, watching)
            self._stack = stack.pop_all()
        return self

    async def __aexit__(self, *_: object) -> None:
        """End the program and all processes that it started."""
        if self._ending is not None:
            self._ending.remove_done_callback(self._on_program_end)
            try:
                await stop_tasks(self._ending)
            finally:
                await self._stack.aclose()

    @property
    def result(self) -> ProgramResult:
        """Return how the program ended, and which of its commands were refused."""
        ended = None if self._program is None else self._program.exit
        return ProgramResult(
            vehicle=self.context.name,
            exit="was not started" if ended is None else str(ended),
            refused=self._gate.refused,
            trouble=self._gate.trouble,
            video=None if self._video is None else self._video.result,
        )

    def on_first_setpoint(self, started: Callable[[str, float], None]) -> None:
        """Call `started(name, t_s)` once, when the program's next setpoint is sent."""
        self._started = started

    def perceive(self, reading: Reading) -> None:
        """Send an image of its camera to the program."""
        if self._video is not None:
            self._video.perceive(reading)

    def perceive_raw(self, reading: Reading) -> None:
        """Ignore a mixture's inputs: the program has one stream."""

    async def fly(self) -> None:
        """Pass the program's setpoints on until cancelled or done."""
        self._gate.flying = True
        if self._video is not None:
            self._video.begin(asyncio.get_running_loop().time())
        try:
            await self.done.wait()
            await self._run_state.reaching("end")
        finally:
            self._gate.flying = False
            if self._video is not None:
                self._decide_blind(self._video.fault_in_all())

    def _decide_blind(self, fault: str) -> None:
        """Decide INVALID, once, when the program was not sent what its vehicle perceived."""
        if fault and not self._is_blind:
            self._is_blind = True
            text = f"the autonomy of {self.context.name} was blind: {fault}"
            self._run_state.decide("INVALID", text, source=f"video/{self.context.name}")

    async def _watch(self, program: ExternalAutonomy) -> None:
        """Watch whether it gets its video; end it when it exceeds its memory limit.

        That is an ERROR before its goal, and a FAIL from then on.
        """
        limits, name = self._under_test.limits, self.context.name
        while program.running:
            excess = limits.excess("the program and its children hold", program.resident_mb)
            if excess:
                text = f"the autonomy of {name} {excess}"
                kind: DecisiveKind = "FAIL" if self._run_state.reached("goal") else "ERROR"
                self._run_state.decide(kind, text, source=f"autonomy/{name}")
                if self._ending is not None:
                    self._ending.remove_done_callback(self._on_program_end)
                program.kill()
                return
            if self._video is not None and self._gate.flying:
                self._decide_blind(self._video.fault(asyncio.get_running_loop().time()))
            await asyncio.sleep(_POLL_S)

    def _on_program_end(self, ending: "asyncio.Task[ProgramExit]") -> None:
        """Handle the program's own end: done, or a crash."""
        if ending.cancelled():
            return
        how = ending.result()
        if how.crashed or not self._gate.flying:
            when = "" if self._gate.flying else ", before it was given the goal"
            self._run_state.decide(
                "FAIL" if self._gate.flying else "ERROR",
                f"the autonomy of {self.context.name} {how}{when}"
                + (f": {how.tail}" if how.tail else ""),
                source=f"autonomy/{self.context.name}",
            )
            return
        # The program is done; PX4 needs setpoints until the landing command.
        self.context.driver.keep_still()
        self.done.set()

    def _environment(self, sdp: Path | None) -> dict[str, str]:
        return autonomy_environment(
            {**os.environ, **self._run_state.environment},
            mavlink_url=f"udpout://{_HOST}:{self._udp.local_port}",
            video_url="" if sdp is None else str(sdp.absolute()),
            goal=self._under_test.goal,
            parameters=self._under_test.parameters,
            vehicle=self.context.name,
            system_id=self._target.system,
            seed=self._seed,
        )

    def _on_frame(self, data: bytes, _t_s: float) -> None:
        self._udp.write(data)

    def _pass_frames(self, data: bytes, t_s: float) -> None:
        for frame in self._splitter.feed(data):
            decision = self._gate.judge(frame)
            if decision != "pass":
                refusal = self._gate.refusal(frame, decision)
                if refusal:
                    self._udp.write(refusal)
                continue
            if frame.message_id in SETPOINTS and self._started is not None:
                self.context.driver.hand_over()
                self._started(self.context.name, t_s)
                self._started = None
            self.context.foreign_setpoints = self._gate.steers_by
            self._link.write(frame.raw)


def program_runner(
    setup: RunSetup, pair: VehiclePair, context: VehicleContext, run_state: RunState
) -> ProgramRunner:
    """Return the runner of a run's program on one vehicle."""
    under_test, vehicle = setup.case.under_test, setup.vehicle(context.name)
    cameras = perceived_cameras(setup.case, setup.mode, vehicle.name)
    return ProgramRunner(
        under_test=under_test,
        program=cast("ProgramAutonomy", under_test.foreign),
        context=context,
        link=pair.links[context.name],
        target=MavlinkTarget(vehicle.system_id),
        camera=next(iter(cameras), None),
        run_state=run_state,
        folder=setup.order.folder,
        seed=setup.seed,
    )


def _video(camera: CameraSetup, sdp: Path) -> ProgramVideo:
    size = camera.intrinsics
    delivery = rtp_delivery(
        width_px=size.width_px,
        height_px=size.height_px,
        rate_hz=camera.rate_hz,
        address=RtpAddress(_HOST, _free_even_port()),
        sdp_path=sdp,
    )
    return ProgramVideo(sensor=camera.name, period_s=1.0 / camera.rate_hz, delivery=delivery)


def _free_even_port() -> int:
    """Return a free UDP port for the program's video; RTP uses even ports."""
    while True:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
            one.bind((_HOST, 0))
            port = int(one.getsockname()[1])
        if port % 2 == 0:
            return port
