"""The campaign file as a whole, and its small parts."""

import re
from functools import cache
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    JsonValue,
    create_model,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticKnownError

from wil_campaign.campaigns.schema.actors import ActorPart
from wil_campaign.campaigns.schema.autonomy import AutonomyPart, autonomy_model
from wil_campaign.campaigns.schema.bench import BenchRequestPart
from wil_campaign.campaigns.schema.between_runs import BetweenRunsPart
from wil_campaign.campaigns.schema.controls import ControlPart
from wil_campaign.campaigns.schema.faults import FaultsPart
from wil_campaign.campaigns.schema.fence import GeofencePart
from wil_campaign.campaigns.schema.limits import LimitsPart
from wil_campaign.campaigns.schema.operator import OperatorPart, operator_model, refused_key_type
from wil_campaign.campaigns.schema.preflight import PreflightPart
from wil_campaign.campaigns.schema.vehicles import Speedup, VehiclesPart
from wil_campaign.campaigns.statistics.sequential_test import SequentialTest
from wil_campaign.campaigns.values.acceptance import DECIDED, parse_pass_share
from wil_campaign.campaigns.values.wanted_firmware import (
    FIRMWARE,
    check_firmware_version,
    names_versions,
)
from wil_campaign.foundation.files.documents import KeyFaultError, Part
from wil_campaign.hooks import campaign_keys, recording_formats, run_observers
from wil_campaign.installed_plugins import absent_additions, load_plugin_object, plugin_additions

Mode = Literal["sim", "wil", "real"]
Takeoff = Literal["liftoff", "command"]
Seconds = Annotated[float, Field(gt=0, le=86_400)]

_MATRIX_KEYS = frozenset(
    {
        "schema",
        "campaign",
        "description",
        "cases",
        "controls",
        "modes",
        "repetitions",
        "seed",
        "retries",
        "accept",
        "published",
        "operator",
        "clock",
        "between_runs",
        "bench",
    }
)


def matrix_keys() -> frozenset[str]:
    """Return the keys that define the matrix of runs, and so cannot differ from case to case."""
    of_plugins = plugin_additions(campaign_keys).values()
    return _MATRIX_KEYS.union(key.name for key in of_plugins if not key.varies)


_SAFE = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


def _safe_name(name: str) -> str:
    """Refuse a campaign or case name that is unsafe as a folder name."""
    if not _SAFE.fullmatch(name):
        raise ValueError(
            f"'{name}' becomes a folder: use up to 64 of A-Z a-z 0-9 . _ - and begin with one "
            "of the letters or digits"
        )
    return name


SafeName = Annotated[str, AfterValidator(_safe_name)]
"""A name that is a folder of the results."""


Cases = dict[SafeName, dict[str, JsonValue] | None]


DEFAULT_CASE = "default"
"""The one case of a campaign that names none."""


def _one_case() -> Cases:
    """Return the cases of a campaign file that names none: the default case."""
    return {DEFAULT_CASE: {}}


class PositionPart(Part):
    """A position of the campaign's goal in the world's local frame, metres.

    north_m, east_m, up_m: from the world's origin.
    """

    north_m: float
    east_m: float
    up_m: float


class GoalPart(Part):
    """The campaign's `goal`: the altitude, and gates in their order or a position.

    altitude_m: to which the vehicles climb after the takeoff, above the world's origin. gates:
    names of gates in the world file, in the order in which they are flown through. position: the
    place to fly to, instead of gates.
    """

    altitude_m: Annotated[float, Field(gt=0, le=10_000)]
    gates: list[str] = Field(default_factory=list)
    position: PositionPart | None = None

    @field_validator("gates")
    @classmethod
    def _once_each(cls, gates: list[str]) -> list[str]:
        """Refuse a campaign goal that names a gate twice."""
        for index, gate in enumerate(gates):
            if gate in gates[:index]:
                raise KeyFaultError(index, f"gate '{gate}' is named twice")
        return gates


class SyncPart(Part):
    """The campaign's `sync`: allowed skews and distance of the pair; a run beyond one is INVALID.

    takeoff: whether the liftoffs, or the takeoff commands, of the vehicles are simultaneous.
    max_twin_distance_m: largest distance of the twin; null: by its coupling. identify_timeout_s:
    time for a vehicle to report its autopilot. ready_timeout_s: time for a vehicle to become ready
    to arm. takeoff_timeout_s: time from the takeoff command until both vehicles are at their
    altitude. takeoff_tolerance_m: distance from the goal's altitude that counts as reached.
    goal_timeout_s: how long the autonomy may fly; by default ten minutes, or longer where an oracle
    time_limit allows it. landing_timeout_s: time from the command to land until the vehicle has
    disarmed. max_command_skew_s: largest time between the takeoff commands. max_takeoff_skew_s:
    largest time between the liftoffs. max_t0_skew_s: largest time between the moments at which both
    receive the goal.
    """

    identify_timeout_s: Seconds = 5.0
    ready_timeout_s: Seconds = 90.0
    takeoff_timeout_s: Seconds = 30.0
    takeoff_tolerance_m: Annotated[float, Field(gt=0, le=100)] = 0.3
    goal_timeout_s: Seconds | None = None
    landing_timeout_s: Seconds = 60.0
    max_command_skew_s: Seconds = 0.1
    max_takeoff_skew_s: Seconds = 1.0
    max_t0_skew_s: Seconds = 0.1
    takeoff: Takeoff = "liftoff"
    max_twin_distance_m: Annotated[float, Field(gt=0, le=10_000)] | None = None


class ClockPart(Part):
    """The campaign's `clock`. speed: how many times faster than real time embedded vehicles fly."""

    speed: Speedup


_ACCEPTS_NOTHING = (
    "requires no run, so the campaign would never be accepted: name modes with their shares "
    "({sim: 5/5}); or remove `accept` to require every run"
)

ImageFormat = Literal["jpeg", "png", "raw", "none"]


def _recording_format(name: str) -> str:
    """Refuse a form of recordings that there is not, or that cannot be written here."""
    if why := absent_additions(recording_formats).get(name):
        raise ValueError(why)
    if name not in (known := plugin_additions(recording_formats)):
        raise PydanticKnownError("literal_error", {"expected": " or ".join(map(repr, known))})
    if why := load_plugin_object(known[name].trouble)():
        raise ValueError(why)
    return name


class RecordPart(Part):
    """The campaign's `record`: the images of run.mcap; only replays of jpeg are not exact.

    quality: of JPEG, 1 to 100. vehicle_logs: whether the vehicles' own logs (.bin, .ulg) are
    fetched into the run's folder after landing. max_loss: share of a topic of run.mcap that may be
    missing, beyond which the run is INVALID; nothing may be missing that decides the verdict.
    pictures: how images are encoded in run.mcap; none records no images; needed records, as JPEG,
    those that cannot be drawn again, and of the others what they were drawn of. video: of which
    runs mixed.mp4 is made of the recorded images after the landing: of those that went wrong and
    the first of each case and mode (failed), of all, or of none. also: forms of other tools in
    which each run is written, too, after the landing.
    """

    pictures: Literal["needed"] | ImageFormat = "needed"
    video: Literal["failed", "always", "never"] = "failed"
    quality: Annotated[int, Field(ge=1, le=100)] = 85
    vehicle_logs: bool = False
    max_loss: Annotated[float, Field(ge=0, le=1)] = 0.01
    also: list[Annotated[str, AfterValidator(_recording_format)]] = Field(default_factory=list)

    @model_validator(mode="after")
    def _has_images_for_its_video(self) -> Self:
        is_wanted = "video" in self.model_fields_set and self.video != "never"
        if self.pictures == "none" and is_wanted:
            message = (
                "is made of the recorded images, but pictures: none records no images; "
                "record them (jpeg), or leave video out"
            )
            raise KeyFaultError("video", message)
        return self


class UntilDecidedPart(Part):
    """The campaign's `repetitions` until a sequential test of the pass rate has decided.

    at_least: the pass rate that is claimed. against: a pass rate that would be too low. most:
    flights of a case and mode after which it stays undecided. error: probability of either wrong
    decision. until: the end of the repetitions of a case and mode.
    """

    until: Literal["decided"]
    at_least: Annotated[float, Field(gt=0, lt=1)]
    against: Annotated[float, Field(gt=0, lt=1)]
    most: Annotated[int, Field(ge=1, le=100_000)]
    error: Annotated[float, Field(gt=0, lt=0.5)] = 0.05

    @model_validator(mode="after")
    def _decidable(self) -> Self:
        """Refuse a test that cannot decide for the claimed pass rate within `most` flights."""
        if self.against >= self.at_least:
            raise KeyFaultError("against", f"must be below at_least, {self.at_least:g}")
        least = self.test.least_flights
        if self.most < least:
            message = f"is too few to decide: {least} flights are needed when all of them pass"
            raise KeyFaultError("most", message)
        return self

    @property
    def test(self) -> SequentialTest:
        """Return the sequential test."""
        return SequentialTest(self.at_least, self.against, self.most, self.error)


class PublishedPart(Part):
    """The campaign's `published`: results of others, shown beside the campaign's own.

    source: where they were published. passed: by case and mode "1/5", or the reason for a missing
    one ("too costly").
    """

    source: str = ""
    passed: dict[str, dict[Mode, str]]


class CampaignPart(Part):
    """A campaign file; `cases` and `oracles` are validated elsewhere, entry by entry.

    actors: objects of the world that vehicles of their own fly, by the object's name.
    schema: the kind and version of the file. campaign: its name, also of the folder of results.
    description: for people. world, recipe: files, relative to this one; mode wil needs the recipe.
    modes: sim (the twin alone), wil (the pair on mixed readings), real (the real vehicle alone).
    cases: variants by name, each with the dotted keys that it overrides, also of world.* and
    recipe.*. controls: runs that must not pass, by name. repetitions: how often each case is flown
    in each mode; or until a sequential test has decided. seed: from which the seed of each run
    derives, with its case and its repetition.
    accept: by case and mode how many runs must pass, "4/5"; by default every run; under `firmware`
    the version that a vehicle must run, as "1.16", or a git hash. published:
    results of others, shown beside the campaign's own. retries: how often a run with the verdict
    ERROR or INVALID is flown again; never with hardware. bench: the place with the real vehicle, by
    name or properties; its file defines vehicles.real and the geofence. collision_always: whether a
    contact fails a run even if `oracles` has no `collision`.
    """

    model_config = ConfigDict(defer_build=True)

    schema_: Literal["wil/campaign/1"] = Field(alias="schema")
    campaign: SafeName
    description: str = ""
    bench: BenchRequestPart | None = None
    vehicles: VehiclesPart
    actors: dict[str, ActorPart] = Field(default_factory=dict)
    world: str
    recipe: str | None = None
    autonomy: AutonomyPart
    goal: GoalPart
    modes: Annotated[list[Mode], Field(min_length=1)]
    cases: Annotated[Cases, Field(min_length=1)] = Field(default_factory=_one_case)
    controls: dict[SafeName, ControlPart] = Field(default_factory=dict)
    repetitions: Annotated[int, Field(ge=1, le=100_000)] | UntilDecidedPart = 1
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    retries: Annotated[int, Field(ge=0, le=10)] = 0
    sync: SyncPart = SyncPart()
    clock: ClockPart | None = None
    between_runs: BetweenRunsPart | None = None
    faults: FaultsPart = FaultsPart()
    preflight: PreflightPart = PreflightPart()
    geofence: GeofencePart | None = None
    limits: LimitsPart | None = None
    oracles: Annotated[dict[str, dict[str, JsonValue] | None], Field(min_length=1)]
    collision_always: Literal["on", "off"] = "on"
    operator: OperatorPart = OperatorPart()
    record: RecordPart = RecordPart()
    accept: dict[str, dict[str, str]] | None = None
    published: PublishedPart | None = None

    @property
    def most_repetitions(self) -> int:
        """Return the largest number of repetitions of a case and mode."""
        given = self.repetitions
        return given if isinstance(given, int) else given.most

    @property
    def sequential_test(self) -> SequentialTest | None:
        """Return the test that may end the repetitions early; None for a fixed number."""
        return None if isinstance(self.repetitions, int) else self.repetitions.test

    @property
    def wanted_firmware(self) -> dict[str, str]:
        """Return the versions that vehicles must run to be accepted, by vehicle."""
        found = (self.accept or {}).get(FIRMWARE, {})
        return found if names_versions(found) else {}

    @property
    def wanted_shares(self) -> dict[str, dict[str, str]] | None:
        """Return by case and mode how many runs must pass; None to require every run."""
        if self.accept is None or not self.wanted_firmware:
            return self.accept
        return {case: one for case, one in self.accept.items() if case != FIRMWARE} or None

    @field_validator("modes")
    @classmethod
    def _distinct(cls, modes: list[Mode]) -> list[Mode]:
        for index, mode in enumerate(modes):
            if mode in modes[:index]:
                raise KeyFaultError(index, f"mode '{mode}' is named twice")
        return modes

    @field_validator("accept")
    @classmethod
    def _shares(cls, accept: dict[str, dict[str, str]] | None) -> dict[str, dict[str, str]] | None:
        if accept is not None and not accept:
            raise ValueError(_ACCEPTS_NOTHING)
        for case, shares in (accept or {}).items():
            if case == FIRMWARE and names_versions(shares):
                _check_versions(shares)
                continue
            if not shares:
                raise KeyFaultError(case, _ACCEPTS_NOTHING)
            for mode, share in shares.items():
                if share == DECIDED:
                    continue
                try:
                    parse_pass_share(share)
                except ValueError as error:
                    raise KeyFaultError((case, mode), str(error)) from error
        return accept


def _check_versions(versions: dict[str, str]) -> None:
    """Raise KeyFaultError for a version that `accept` cannot ask for."""
    for vehicle, text in versions.items():
        if vehicle not in {"real", "twin"}:
            raise KeyFaultError((FIRMWARE, vehicle), "must be of real or twin")
        try:
            check_firmware_version(text)
        except ValueError as error:
            raise KeyFaultError((FIRMWARE, vehicle), str(error)) from error


@cache
def campaign_model() -> type[CampaignPart]:
    """Return the model of campaign files, with the keys that plugins add.

    A key of a shipped plugin that is not installed is refused by the plugin's name.
    """
    own = frozenset(CampaignPart.model_fields)
    keys: dict[str, Any] = {
        name: (load_plugin_object(key.part) | None, Field(default=None, description=key.summary))
        for name, key in plugin_additions(campaign_keys, own).items()
    }
    observers = plugin_additions(run_observers, own.union(keys))
    keys |= {name: load_plugin_object(observer.field)() for name, observer in observers.items()}
    for hook in (campaign_keys, run_observers):
        keys |= {
            name: (refused_key_type(why), None) for name, why in absent_additions(hook).items()
        }
    keys["operator"] = (operator_model(), operator_model()())
    keys["autonomy"] = (autonomy_model(), ...)
    return create_model(
        CampaignPart.__name__, __base__=CampaignPart, __doc__=CampaignPart.__doc__, **keys
    )
