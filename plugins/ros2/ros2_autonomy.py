"""An autonomy that is a ROS 2 node: what a campaign says of it, and its checks."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field

from wil_campaign.campaigns.setup.autonomy_under_test import ForeignAutonomy
from wil_campaign.plugins.ros2.ros2_part import Ros2Part
from wil_campaign.worlds.files.documents import Document, Problem

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

    def problems(self, campaign: Document, folder: Path) -> list[Problem]:
        """Return a program or file that is missing, and a wire that is not installed."""
        faults = self.part.faults(folder)
        return [campaign.problem(("autonomy", self.kind, *one.path), str(one)) for one in faults]
