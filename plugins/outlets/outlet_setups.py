"""The setups of image outlets and of a ground station, and their checks; pure."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from wil_campaign.campaigns.schema import Mode, VehicleName
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import FLIES, Case, ObserverSetup
from wil_campaign.foundation.files.documents import Path, Problem, closest_word
from wil_campaign.recipes.working import Side


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageOutlet:
    """An external outlet for the images of one camera, or by zmq for the readings of any sensor.

    of: the image that a vehicle perceives, or the unmixed one of a vehicle. vehicle: whose; None:
    the judged one's. address: HOST:PORT, an endpoint to bind, or a device.
    """

    kind: Literal["rtp", "zmq", "v4l2"]
    address: str
    sensor: str
    of: Literal["perceived", "real", "twin"] = "perceived"
    vehicle: Side | None = None
    encoding: str = "bgr8"
    topic: str = "mixed"
    key_interval_s: float = 1.0
    max_bit_rate: int | None = None

    @property
    def name(self) -> str:
        """Return the outlet's name in messages ("rtp 127.0.0.1:5600")."""
        return f"{self.kind} {self.address}"


@dataclass(frozen=True, slots=True)
class DeliverySetups(ObserverSetup):
    """All image outlets of a case."""

    outlets: tuple[ImageOutlet, ...]

    def problems(self, files: CaseFiles, case: Case, mode: Mode, /) -> Iterator[Problem]:
        """Yield the problems of one mode's image outlets."""
        seen: dict[str, int] = {}
        for index, outlet in enumerate(self.outlets):
            yield from _outlet(files, case, mode, index, outlet)
            if outlet.address.endswith(":*"):
                continue  # a free port each
            first = seen.setdefault(outlet.name, index)
            if first != index:
                message = f"{outlet.name} is already used by delivery {first + 1}"
                yield files.campaign.problem(("deliver", index), message)

    def needing_wall_clock(self) -> Iterator[tuple[Path, str]]:
        """Yield each image outlet: its path in the campaign, its name."""
        for index, outlet in enumerate(self.outlets):
            yield ("deliver", index), outlet.name


@dataclass(frozen=True, slots=True)
class GroundStationSetup(ObserverSetup):
    """A ground station that receives contacts, and RTP streams as a camera's. link: to it."""

    link: str

    def needing_wall_clock(self) -> Iterator[tuple[Path, str]]:
        """Yield the link: its path in the campaign, its name."""
        yield ("ground_station",), f"a ground station at {self.link}"


def _outlet(
    files: CaseFiles, case: Case, mode: Mode, index: int, outlet: ImageOutlet
) -> Iterator[Problem]:
    """Yield the problems of an external image outlet (`deliver`) in a mode."""
    path: Path = ("deliver", index)
    wanted = _vehicle_of(outlet, mode)
    if wanted not in FLIES[mode]:
        return  # this vehicle is not part of this mode
    cameras = [camera.name for camera in case.vehicles[wanted].cameras]
    sensors = [sensor.name for sensor in case.vehicles[wanted].sensors]
    if outlet.sensor in cameras or (outlet.kind == "zmq" and outlet.sensor in sensors):
        return
    if outlet.sensor in sensors:
        message = f"{outlet.kind} delivers images, and '{outlet.sensor}' is no camera; use zmq"
        yield files.campaign.problem((*path, "sensor"), message)
    elif outlet.kind == "zmq":
        message = f"vehicle '{wanted}' has no sensor '{outlet.sensor}'"
        yield files.campaign.problem(
            (*path, "sensor"), message, closest_word(outlet.sensor, sensors)
        )
    else:
        message = f"vehicle '{wanted}' has no camera '{outlet.sensor}'"
        yield files.campaign.problem(
            (*path, "sensor"), message, closest_word(outlet.sensor, cameras)
        )


def _vehicle_of(outlet: ImageOutlet, mode: Mode) -> VehicleName:
    if outlet.of == "perceived":
        return outlet.vehicle or FLIES[mode][0]
    return outlet.of
