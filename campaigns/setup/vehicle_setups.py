"""Setups of vehicles: link, autopilot, start, telemetry rates and sensors, from a campaign file."""

import math
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from wil_campaign.campaigns.schema.actors import ActorPart
from wil_campaign.campaigns.schema.sources import SourcedPart
from wil_campaign.campaigns.schema.vehicles import (
    VEHICLES,
    SigningPart,
    VehicleName,
    VehiclePart,
    VehiclesPart,
)
from wil_campaign.campaigns.setup.external_reader import sensor_setups
from wil_campaign.campaigns.values.external_setups import (
    CAPTURED,
    ESTIMATED,
    SIMULATED,
    MocapSetup,
    PoseAccuracy,
    PoseSource,
    ReadingSourceSetup,
)
from wil_campaign.campaigns.values.sensor_setups import CameraSetup, SensorSetup, SourcedSetup
from wil_campaign.foundation.files.documents import (
    BadInput,
    Document,
    KeyFaultError,
    Problem,
    closest_file,
    closest_word,
)
from wil_campaign.foundation.files.documents import Path as KeyPath
from wil_campaign.foundation.files.paths import path_exists
from wil_campaign.vehicles.autopilots.autopilot import MessageRate, TelemetryRates
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.command_backends import OWN_FRAMES
from wil_campaign.vehicles.coupling import Coupling
from wil_campaign.vehicles.embedded.autopilot.known_parameters import (
    known_parameters,
    unused_parameters,
)
from wil_campaign.vehicles.embedded.physics.airframe import Airframe
from wil_campaign.vehicles.embedded.physics.config import Physics
from wil_campaign.vehicles.embedded.physics.contact_world import contact_box_of
from wil_campaign.vehicles.embedded.profile import ProfileError, load_profile
from wil_campaign.vehicles.launch import (
    LaunchError,
    LaunchPart,
    SimulatorLaunch,
    path_beside_campaign,
)
from wil_campaign.vehicles.links.link_conditions import KeySource
from wil_campaign.vehicles.links.link_strings import LinkAddress, parse_link
from wil_campaign.vehicles.mavlink.names import message_number
from wil_campaign.vehicles.telemetry_fit import RadioTooSlowError, fitted_telemetry_rates
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.parts import BoxShape

VehicleLink = Literal["embedded"] | LinkAddress | SimulatorLaunch

_SERIAL_SHARE = 0.8
"""Of ten bits on a serial line, eight are data."""
_SYSTEM_IDS: dict[VehicleName, int] = {"real": 1, "twin": 2}
_USUAL_ACCURACY: Mapping[PoseSource, PoseAccuracy] = {
    "simulator": SIMULATED,
    "mocap": CAPTURED,
    "mavlink": ESTIMATED,
}
EMBEDDED_BODY: BoxShape = contact_box_of(Airframe())
"""The body by which a vehicle is judged, where the campaign gives none: the embedded one's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownSetup:
    """The setup of any vehicle of a run, of the pair or an actor.

    link: "embedded", the address of an attached one, or the launch of a simulation. profile: for
    `load_profile`: a name, or an absolute path. physics: of an embedded one. params: autopilot
    parameters by name. start: where it stands, world frame. signing: the source of its key.
    rates: of telemetry, as its slowest radio carries them. spares: further links of an attached
    one. permits_dead_reckoning: whether its flight goes on where nothing holds its position any
    more. has_gps: otherwise its estimator gets the world's origin where it has none.
    """

    name: str
    link: VehicleLink
    autopilot: str
    profile: str
    start: Pose
    system_id: int
    physics: Physics = "jsbsim"
    driver: str = OWN_FRAMES
    pose_source: PoseSource = "mavlink"
    params: Mapping[str, float] = field(default_factory=dict)
    signing: KeySource | None = None
    rates: TelemetryRates = field(default_factory=TelemetryRates)
    spares: tuple[LinkAddress, ...] = ()
    permits_dead_reckoning: bool = False
    has_gps: bool = True

    @property
    def path(self) -> KeyPath:
        """Return the vehicle's place in the campaign file."""
        return "vehicles", self.name

    @property
    def standing_pose(self) -> Pose:
        """Return the vehicle's pose in W before it takes off."""
        return self.start

    @property
    def embedded(self) -> bool:
        """Return whether the vehicle is our embedded simulation."""
        return self.link == "embedded"

    @property
    def attached(self) -> LinkAddress | None:
        """Return the address of a vehicle neither embedded nor launched; it may be hardware."""
        return self.link if isinstance(self.link, LinkAddress) else None

    @property
    def addresses(self) -> tuple[LinkAddress, ...]:
        """Return all link addresses of an attached vehicle; none of another."""
        return () if self.attached is None else (self.attached, *self.spares)

    @property
    def launch(self) -> SimulatorLaunch | None:
        """Return the launch of the vehicle's simulation; None for one that is not launched."""
        return self.link if isinstance(self.link, SimulatorLaunch) else None

    @property
    def launch_pace(self) -> float | None:
        """Return the pace (times real time) of a launched vehicle; None when not launched."""
        return None if self.launch is None else self.launch.pace

    @property
    def requests_truth(self) -> bool:
        """Return whether its simulator has to report the true pose: to judge, or to compare."""
        return self.pose_source == "simulator" or self.launch is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleSetup(FlownSetup):
    """The setup of a vehicle of the pair.

    mocap: None: the surrogate's own motion capture. pose_accuracy: of its pose source;
    accuracy_given: by the campaign. max_gap_s: the longest accepted gap between its positions;
    None: derived from their rate. coupling: of the twin, how it follows the real vehicle. body: by
    which it is judged. asks_pose_source: whether its file leaves the pose source of an attached
    vehicle open, so that its ground truth is taken where it is a simulation that offers it.
    """

    name: VehicleName
    asks_pose_source: bool = False
    anchor: Literal["start", "mocap"] = "start"
    mocap: MocapSetup | None = None
    pose_accuracy: PoseAccuracy = ESTIMATED
    accuracy_given: bool = False
    sensors: tuple[SensorSetup, ...] = ()
    max_gap_s: float | None = None
    coupling: Coupling = "follow"
    body: BoxShape = EMBEDDED_BODY

    @property
    def reports_accuracy(self) -> bool:
        """Return whether the vehicle's estimator has to report the accuracy of its poses."""
        return self.pose_source == "mavlink" and not self.accuracy_given

    @property
    def cameras(self) -> tuple[CameraSetup, ...]:
        """Return the vehicle's cameras."""
        return tuple(sensor for sensor in self.sensors if isinstance(sensor, CameraSetup))

    @property
    def sourced(self) -> tuple[tuple[SourcedSetup, ReadingSourceSetup], ...]:
        """Return the sensors, except cameras, whose readings are external, each with its source."""
        return tuple(
            (sensor, sensor.source)
            for sensor in self.sensors
            if not isinstance(sensor, CameraSetup) and sensor.source is not None
        )


def vehicle_setups(
    file: Document, part: VehiclesPart, problems: list[Problem]
) -> dict[VehicleName, VehicleSetup]:
    """Return the setups of a campaign's vehicles; problems are collected."""
    given = {name: getattr(part, name) for name in VEHICLES}
    return {
        name: _vehicle(file, name, one, problems) for name, one in given.items() if one is not None
    }


def _vehicle(
    file: Document, name: VehicleName, part: VehiclePart, problems: list[Problem]
) -> VehicleSetup:
    at: KeyPath = ("vehicles", name)
    if part.link == "embedded":
        problems += unknown_parameters(file, at, part.autopilot, part.params)
    return VehicleSetup(
        name=name,
        link=vehicle_link_of(file, at, part.link, part.params, problems),
        autopilot=part.autopilot,
        profile=vehicle_profile_of(file, at, part.profile, problems),
        physics=part.physics,
        start=part.start.pose(),
        driver=part.driver,
        system_id=part.system_id or _SYSTEM_IDS[name],
        anchor=part.anchor,
        pose_source=part.poses_from,
        asks_pose_source=part.leaves_poses_open,
        params=dict(part.params),
        mocap=None if part.mocap is None else part.mocap.setup(name),
        pose_accuracy=_pose_accuracy(part),
        accuracy_given=part.pose_accuracy is not None,
        sensors=sensor_setups(file, name, part, problems),
        signing=key_source_of(file, part.signing),
        rates=telemetry_rates_of(file, at, part, problems),
        max_gap_s=part.telemetry.max_gap_s,
        spares=tuple(parse_link(spare_link) for spare_link in part.spare_links),
        coupling=part.coupling,
        permits_dead_reckoning=part.permit_dead_reckoning,
        has_gps=part.gps,
        body=EMBEDDED_BODY if part.body is None else part.body.shape(),
    )


def _pose_accuracy(part: VehiclePart) -> PoseAccuracy:
    """Return a vehicle's pose accuracy: as given, else the default of its pose source."""
    usual = _USUAL_ACCURACY[part.poses_from]
    return usual if part.pose_accuracy is None else part.pose_accuracy.setup(usual)


def unknown_parameters(
    file: Document, at: KeyPath, autopilot: str, params: Iterable[str]
) -> Iterator[Problem]:
    """Yield `params` of an embedded vehicle that its autopilot does not have; at: its place."""
    known = known_parameters(autopilot)
    for parameter in params:
        if parameter not in known:
            message = f"the embedded {autopilot} has no parameter '{parameter}'"
            path = (*at, "params", parameter)
            yield file.problem(path, message, closest_word(parameter, known), key=True)


def unused_settings(
    file: Document, at: KeyPath, autopilot: str, params: Mapping[str, float]
) -> Iterator[Problem]:
    """Yield warnings for `params` on which the embedded autopilot does not act; at: its place."""
    unused = unused_parameters(autopilot)
    for parameter, value in params.items():
        if parameter in unused and value != unused[parameter]:
            message = f"the embedded {autopilot} carries '{parameter}', and nothing acts on it"
            yield file.problem((*at, "params", parameter), message, key=True)


def vehicle_link_of(
    file: Document,
    at: KeyPath,
    link: str | LaunchPart,
    params: Mapping[str, float],
    problems: list[Problem],
) -> VehicleLink:
    """Return a vehicle's link: embedded, attached at an address, or launched with parameters.

    at: the vehicle's place in the campaign.
    """
    if link == "embedded":
        return "embedded"
    if isinstance(link, str):
        return parse_link(link)
    launch = replace(link.setup(file.path.parent), params=tuple(sorted(params.items())))
    try:
        launch.check()
    except LaunchError as error:
        problems.append(file.problem((*at, "link"), str(error), key=True))
    return launch


def telemetry_rates_of(
    file: Document, at: KeyPath, part: VehiclePart | ActorPart, problems: list[Problem]
) -> TelemetryRates:
    """Return the telemetry rates that a vehicle's radio can carry; at: its place."""
    telemetry = part.telemetry
    rate_hz = telemetry.rate_hz
    truth_hz = rate_hz if part.poses_from == "simulator" else 0.0
    wanted = TelemetryRates(
        position_hz=rate_hz,
        attitude_hz=rate_hz,
        truth_hz=truth_hz,
        sensors=tuple(_sensor_messages(part)) if isinstance(part, VehiclePart) else (),
    )
    radio_bit_s = _SERIAL_SHARE * (_baud(part) or math.inf)
    path: KeyPath = (*at, "link")
    if telemetry.bandwidth_kbit_s is not None:
        radio_bit_s = telemetry.bandwidth_kbit_s * 1e3
        path = (*at, "telemetry", "bandwidth_kbit_s")
    if math.isinf(radio_bit_s):
        return wanted
    autopilot, signed = autopilot_named(part.autopilot), part.signing is not None
    try:
        return fitted_telemetry_rates(autopilot, wanted, radio_bit_s=radio_bit_s, signed=signed)
    except RadioTooSlowError as error:
        problems.append(file.problem(path, str(error)))
        return wanted


def _sensor_messages(part: VehiclePart) -> Iterator[MessageRate]:
    """Yield the messages in which a vehicle's autopilot has to send its sensors' readings."""
    for sensor in part.sensors.values():
        if not isinstance(sensor, SourcedPart):
            continue
        with suppress(KeyFaultError):  # `sensor_setups` reports it
            message, often_hz = sensor.sourced_from(part.autopilot), sensor.setup("").rate_hz
            if message is not None and often_hz is not None:
                yield MessageRate(message_number(message), often_hz, required=False)


def _baud(part: VehiclePart | ActorPart) -> int | None:
    """Return the baud rate of a vehicle's slowest serial port; None without one."""
    if not isinstance(part.link, str) or part.link == "embedded":
        return None
    spares = part.spare_links if isinstance(part, VehiclePart) else ()
    addresses = [parse_link(one) for one in (part.link, *spares)]
    return min((address.baud for address in addresses if address.baud), default=None)


def key_source_of(file: Document, part: SigningPart | None) -> KeySource | None:
    """Return the source of a vehicle's signing key: a file or an environment variable."""
    if part is None:
        return None
    if part.file is not None:
        return KeySource("file", str(path_beside_campaign(file.path.parent, part.file)))
    return KeySource("environment", part.environment or "")


def vehicle_profile_of(
    campaign: Document, at: KeyPath, profile: str, problems: list[Problem]
) -> str:
    """Return the profile of a vehicle, a name or an absolute path; its problems are collected.

    at: the vehicle's place in the campaign.
    """
    path: KeyPath = (*at, "profile")
    shown_as = None
    if profile.endswith((".yaml", ".yml")):
        file = campaign.path.parent / profile
        if not path_exists(file):
            message = f"there is no file '{profile}' beside the campaign"
            others = [one.name for one in file.parent.glob("*.y*ml")]
            found = closest_file(file.name, others)
            meant = str(Path(profile).parent / found) if found else ""
            problems.append(campaign.problem(path, message, meant))
            return profile
        shown_as = os.path.normpath(Path(campaign.name).parent / profile)
        profile = str(file.resolve())
    try:
        load_profile(profile, shown_as=shown_as)
    except ProfileError as error:
        problems.append(campaign.problem(path, str(error), error.suggestion))
    except BadInput as error:
        problems += error.problems
    return profile
