"""An autonomy that is a ROS 2 node: what a campaign says of it, and its checks."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pydantic import Field

from wil_campaign.campaigns.setup.autonomy_under_test import ForeignAutonomy
from wil_campaign.foundation.files.documents import Document, KeyFaultError, Problem
from wil_campaign.foundation.files.problems import closest_word
from wil_campaign.plugins.ros2.ros2_part import Ros2Part

_SUMMARY = "Instead, a ROS 2 node."


def ros2_field() -> tuple[Any, Any]:
    """Return the type and the field of the key `ros2`."""
    return Ros2Part | None, Field(default=None, description=_SUMMARY)


@dataclass(frozen=True, slots=True)
class Ros2Autonomy(ForeignAutonomy):
    """A ROS 2 node, which the run calls by way of its topics."""

    part: Ros2Part

    @property
    def kind(self) -> str:
        """Return the key of `autonomy` that has a node."""
        return "ros2"

    @property
    def text(self) -> str:
        """Return the node in messages, with why it needs the wall clock."""
        part = self.part
        if part.found:
            return f"the ROS 2 node in domain {part.domain}"
        without = " (without a barrier)" if self.needs_wall_clock else ""
        return f"the ROS 2 node {' '.join(part.argv[:2])}{without}"

    @property
    def needs_wall_clock(self) -> bool:
        """Return whether no time waits for the node's answers."""
        return self.part.found is True or self.part.barrier is None

    @property
    def is_shared(self) -> bool:
        """Return whether the node, or its domain, is one for all runs."""
        return self.part.domain is not None

    def problems(self, file: Document, folder: Path) -> list[Problem]:
        """Return a program or file that is missing, a wire that is not installed, no topics."""
        faults = self.part.faults(folder)
        found = [file.problem(("autonomy", self.kind, *fault.path), str(fault)) for fault in faults]
        limit = ("autonomy", "limits", "memory_mb")
        if file.get(limit) is not None:
            found.append(file.problem(limit, "has no effect with a ROS 2 node", key=True))
        if find_spec("rosbags") is None:  # whose types the topics have: a problem says so
            return found
        found += _same_topics(file)
        return [*found, *self._px4_problems(file, folder), *self._unknown(file)]

    def _px4_problems(self, file: Document, folder: Path) -> Iterator[Problem]:
        """Yield what of PX4's definitions is missing, or cannot be read."""
        from wil_campaign.plugins.ros2.px4.px4_types import px4_types  # noqa: PLC0415 - of an extra

        if self.part.px4_msgs is None:
            return
        try:
            px4_types(self.part.distribution, folder / self.part.px4_msgs)
        except KeyFaultError as error:
            yield file.problem(("autonomy", self.kind, *error.path), str(error))

    def _unknown(self, file: Document) -> Iterator[Problem]:
        """Yield topics of `topics`, `needs` and `barrier` that no run has."""
        from wil_campaign.plugins.ros2.messages.topics import (  # noqa: PLC0415 - of an extra
            OWN,
            SETPOINTS,
            WORDS,
        )
        from wil_campaign.plugins.ros2.px4.px4_types import (  # noqa: PLC0415
            PX4_OUT,
            PX4_SETPOINTS,
            PX4_WORDS,
        )

        has_px4 = self.part.px4_msgs is not None
        own = (*OWN, *PX4_OUT) if has_px4 else OWN
        ours = {out_topic.name for out_topic in own} | set(_topics_of_sensors(file, self.part))
        received = {*SETPOINTS, *WORDS} | ({*PX4_SETPOINTS, *PX4_WORDS} if has_px4 else set())
        for topic in self.part.topics:
            if topic not in ours | received:
                message = f"'{topic}' is no topic of the run, so it cannot be renamed or left out"
                where = ("autonomy", self.kind, "topics", topic)
                yield file.problem(where, message, closest_word(topic, ours | received))
        yield from self._doubled(file, ours, received)
        known = {name for name in ours if self.part.topics.get(name, name) is not None}
        known |= {self.part.topics[name] or "" for name in known & set(self.part.topics)}
        barrier = [] if self.part.barrier is None else self.part.barrier.topics
        lists = (("needs",), self.part.needs), (("barrier", "topics"), barrier)
        named = [((*key, at), one) for key, topics in lists for at, one in enumerate(topics)]
        for path, topic in named:
            if topic not in known:
                message = f"nothing is published on '{topic}'"
                where = ("autonomy", self.kind, *path)
                yield file.problem(where, message, closest_word(topic, known))

    def _doubled(
        self, file: Document, ours: Collection[str], received: Collection[str]
    ) -> Iterator[Problem]:
        """Yield names that two topics have: their messages would come as those of one.

        Of received topics a name may be that of another, which then is not listened to.
        """
        renamed = self.part.topics
        inputs = ("/real/", "/twin/")  # of mixtures: published by `publish_raw` alone
        published = {
            name: renamed.get(name, name)
            for name in ours
            if name in renamed or not name.startswith(inputs)
        }
        listened = {name: to for name, to in renamed.items() if name in received}
        for names in (published, listened):
            for name, to in renamed.items():
                same = sorted(one for one in names if one != name and names[one] == to)
                if name in names and to is not None and same:
                    message = f"'{to}' is the name of {', '.join(same)}, too"
                    yield file.problem(("autonomy", self.kind, "topics", name), message)


def _same_topics(file: Document) -> Iterator[Problem]:
    """Yield the sensors of a vehicle whose names differ, and whose topics do not."""
    from wil_campaign.plugins.ros2.messages.reading_messages import ros_word_of_name  # noqa: PLC0415

    for vehicle, sensors in _sensors(file):
        words: dict[str, str] = {}
        for name in sensors:
            first = words.setdefault(ros_word_of_name(name), name)
            if first != name:
                message = f"'{name}' has the topics of '{first}' in ROS: rename one of them"
                yield file.problem(("vehicles", vehicle, "sensors", name), message, key=True)


def _sensors(file: Document) -> Iterator[tuple[str, Mapping[str, object]]]:
    """Yield the vehicles with their sensors, by name."""
    vehicles = file.get(("vehicles",))
    for name, vehicle in vehicles.items() if isinstance(vehicles, dict) else ():
        sensors = vehicle.get("sensors") if isinstance(vehicle, dict) else None
        if isinstance(sensors, dict):
            yield str(name), {str(sensor): value for sensor, value in sensors.items()}


def _topics_of_sensors(file: Document, part: Ros2Part) -> Iterator[str]:
    """Yield the topics of the vehicles' sensors, mixed and as they were before."""
    from wil_campaign.plugins.ros2.messages.reading_messages import ros_word_of_name  # noqa: PLC0415
    from wil_campaign.plugins.ros2.messages.topics import sensor_topics  # noqa: PLC0415

    for _, sensors in _sensors(file):
        for name, sensor in sensors.items():
            kind = str(sensor.get("type")) if isinstance(sensor, dict) else ""
            for path in ("", "real/", "twin/"):
                topics = sensor_topics(
                    path + ros_word_of_name(name), kind, compressed=part.compressed
                )
                yield from (topic.name for topic in topics)
