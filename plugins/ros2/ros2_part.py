"""`autonomy.ros2`: the node under test, its wire, its topics, and what time waits for."""

import os
import re
import shutil
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, ConfigDict, Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError, Part

Distribution = Literal["humble", "iron", "jazzy", "kilted"]
WireName = Literal["zenoh", "rclpy"]
_TOPIC = re.compile(r"/[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
_STARTS = ("command", "run", "launch", "found")
INSTALL = "pip install 'wil-campaign[ros2]'"


def _is_topic(name: str) -> str:
    if not _TOPIC.fullmatch(name):
        raise ValueError(
            f"'{name}' is no topic: begin with / and use letters, digits and _ between slashes"
        )
    return name


Topic = Annotated[str, AfterValidator(_is_topic)]
Words = Annotated[list[Annotated[str, Field(min_length=1)]], Field(min_length=1)]


class BarrierPart(Part):
    """The `barrier` of a ROS 2 autonomy: topics of which time waits for the answer to each message.

    topics: messages on them are answered by a setpoint with the same header.stamp. timeout_s: wall
    time within which. It works on clocks that can wait, virtual and scaled; on the wall clock
    nothing waits.
    """

    topics: Annotated[list[Topic], Field(min_length=1)]
    timeout_s: Annotated[float, Field(ge=0.1, le=25)] = 10.0


class Ros2Part(Part):
    """The `ros2` of the campaign's autonomy: a node that is started with a run, or found.

    command: program and arguments, run in the folder of this file. run: package, executable and
    arguments of `ros2 run`. launch: a launch file beside this one. found: the node runs already.
    wire: zenoh, of rmw_zenoh and of nodes without ROS; or rclpy, of any middleware that the node's
    own Python has. python: the interpreter that has rclpy. distribution: whose message definitions
    count. topics: other names for topics by their names here; null is not published, or not
    listened to. px4_msgs: the folder of PX4's message definitions, for a node that flies by them.
    compressed: whether images are published as CompressedImage, too. needs: topics without which
    the node is blind. barrier: what time waits for. start_s: how long the node may take until it
    subscribes. silent_s: how long it may publish no setpoint. domain: of ROS; by default a free one
    for each run.
    """

    model_config = ConfigDict(frozen=True)

    command: Words | None = None
    run: Annotated[list[str], Field(min_length=2)] | None = None
    launch: Annotated[str, Field(min_length=1)] | None = None
    found: Literal[True] | None = None
    wire: WireName = "zenoh"
    python: Annotated[str, Field(min_length=1)] = "python3"
    distribution: Distribution = "jazzy"
    topics: dict[Topic, Topic | None] = Field(default_factory=dict)
    px4_msgs: Annotated[str, Field(min_length=1)] | None = None
    compressed: bool = False
    needs: list[Topic] = Field(default_factory=list)
    barrier: BarrierPart | None = None
    start_s: Annotated[float, Field(ge=0.1, le=600)] = 20.0
    silent_s: Annotated[float, Field(ge=0.5, le=60)] = 5.0
    domain: Annotated[int, Field(ge=0, le=101)] | None = None

    @model_validator(mode="after")
    def _one_start(self) -> Self:
        """Require one way to start the node."""
        given = [name for name in _STARTS if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                "give one of command: [PROGRAM, ...], run: [PACKAGE, EXECUTABLE], launch: FILE, "
                f"and found: true (there are {', '.join(given) or 'none'})"
            )
        if self.found and self.domain is None:
            raise KeyFaultError("found", "give the domain of the node, too: domain: 0")
        if self.python != "python3" and self.wire != "rclpy":
            raise KeyFaultError("python", "has no effect with the wire zenoh")
        return self

    @property
    def argv(self) -> tuple[str, ...]:
        """Return the command that starts the node; empty for one that is found."""
        if self.command is not None:
            return tuple(self.command)
        if self.run is not None:
            return ("ros2", "run", *self.run)
        return () if self.launch is None else ("ros2", "launch", self.launch)

    def faults(self, folder: Path) -> Iterator[KeyFaultError]:
        """Yield a program or file that is missing, and a wire that is not installed."""
        if self.argv:
            yield from self._program_faults(folder)
        if self.launch is not None and not (folder / self.launch).is_file():
            yield KeyFaultError("launch", f"there is no file '{self.launch}' beside the campaign")
        missing = [name for name in ("rosbags", "zenoh") if find_spec(name) is None]
        if "rosbags" in missing or (self.wire == "zenoh" and missing):
            yield KeyFaultError("wire", f"needs {' and '.join(missing)}: {INSTALL}")
        if self.wire == "rclpy" and _program_path(self.python, folder) is None:
            yield KeyFaultError("python", f"there is no program '{self.python}'")

    def _program_faults(self, folder: Path) -> Iterator[KeyFaultError]:
        program = self.argv[0]
        key = next(name for name in _STARTS if getattr(self, name) is not None)
        path = (key, 0) if key == "command" else (key,)
        found = _program_path(program, folder)
        if found is None:
            remedy = "" if key == "command" else "; source the setup.bash of ROS 2 first"
            yield KeyFaultError(path, f"there is no program '{program}'{remedy}")
        elif not os.access(found, os.X_OK):
            yield KeyFaultError(path, f"'{program}' is not executable: chmod +x it")
        scripts = [(at, one) for at, one in enumerate(self.command or ()) if one.endswith(".py")]
        for at, script in scripts[:1]:
            if not (folder / script).is_file():
                yield KeyFaultError(("command", at), f"there is no file '{script}'")


def _program_path(program: str, folder: Path) -> str | None:
    """Return the path of a program, relative to a folder or in PATH; None where there is none."""
    if "/" not in program:
        return shutil.which(program)
    path = folder / program
    return str(path) if path.is_file() else None
