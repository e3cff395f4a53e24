"""The hooks: what a plugin adds to the program, each as a function that returns it.

A plugin is a module with some of these functions, each under `@implements`. It is imported whenever
the program starts: what it returns names its code as `module:name`, imported when it is needed.
`wil_campaign.installed_plugins` finds the plugins; docs/plugins.md shows one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from keyword import iskeyword
from typing import Literal, get_args

import pluggy

PROJECT = "wil_campaign"
"""The group of entry points in which a distribution names its plugins."""

implements = pluggy.HookimplMarker(PROJECT)
"""Marks a plugin's function as its implementation of the hook of that name."""
_hook = pluggy.HookspecMarker(PROJECT)


HelpSection = Literal["start", "fly", "look", "operate"]
"""The sections of `wil-campaign --help`, in their order."""


class _Option:
    """What adds an option of a command: it has its name."""

    __slots__ = ()
    name: str

    def __post_init__(self) -> None:
        """Raise ValueError for a name that an option cannot have."""
        if not self.name.isidentifier() or iskeyword(self.name):
            text = "is no name of an option: one word of letters, digits and _"
            raise ValueError(f"{self.name!r} {text}")


@dataclass(frozen=True, slots=True)
class Command:
    """A command of the command line.

    name: one word; of a command in a group two, as "bench serve". function: whose parameters and
    docstring are the options and the help, and which returns the exit code; "" of a group, which
    stands before its commands. summary: its line of `wil-campaign --help`. section: where that line
    stands, by what a person wants to do. flies: it flies on this machine; what its runs are forked
    from starts while it is imported.
    """

    name: str
    function: str
    summary: str
    section: HelpSection = "look"
    flies: bool = False

    def __post_init__(self) -> None:
        """Raise ValueError for a section that the help does not have."""
        if self.section not in (known := get_args(HelpSection)):
            raise ValueError(f"section is {self.section!r}, not {', '.join(known)}")


@dataclass(frozen=True, slots=True)
class CampaignKey:
    """A key at the top of a campaign file.

    name: the key. part: the class of its value, a `Part`. check: a function that `validate` calls
    with each loaded campaign that has the key; it raises BadInput. summary: what JSON Schemas say
    of it. varies: whether cases may differ in it, by overrides.
    """

    name: str
    part: str
    check: str
    summary: str
    varies: bool


@dataclass(frozen=True, slots=True)
class LiveView(_Option):
    """A live view of runs in flight, which `wil-campaign run` opens beside them by an option.

    name: the option, which takes an address. help: of the option. beside: a function of the
    address, of `say`, which receives the lines for the user, and of the keywords `folder` (only
    campaigns that write there) and `program` (only the campaign of that process), each or None. It
    returns a context manager, in which the view is open, or raises LiveViewError. feed: a class
    derived from RunFeed, by which every run feeds the view; empty for one that another's feeds.
    """

    name: str
    beside: str
    help: str
    feed: str = ""


@dataclass(frozen=True, slots=True)
class RecipeFormat:
    """A format of recipe files beside YAML.

    name: the suffix of its files, as ".xml". parse: a function of the file's bytes and of the
    keywords `name` (what to call it in messages) and `path`; it returns the document of the YAML
    form, or raises BadInput.
    """

    name: str
    parse: str


@dataclass(frozen=True, slots=True)
class Engine:
    """An engine, by which runs fly elsewhere than in processes of this machine.

    name: the value of `--engine`, or what it has before "://". values: all of its values, in words.
    check: a function of the value; it raises EngineError for one that cannot be used. start: a
    function with the parameters of `on_engine`, and the keyword `store` (a Store or None), which
    returns what that returns. on_bench: the same of `ready_flight`, for a campaign that requests a
    bench; further parameters are its document and the request. store: a function of the value of
    `--store`, which returns the Store, or raises EngineError; empty where none is used. fetch: a
    function of a results folder that is resumed, and of the keyword `say`, which brings what its
    nodes have finished since into that folder; empty where they write there themselves. help: what
    `run` says of its values, and of what they need.
    """

    name: str
    values: str
    check: str
    start: str
    on_bench: str
    store: str = ""
    fetch: str = ""
    help: str = ""


@dataclass(frozen=True, slots=True)
class VehicleDriver:
    """What sends a vehicle's commands, named by `driver` in a campaign; it needs the wall clock.

    name: the value of the key. backend: a function of the keyword `name` (the vehicle's, for
    messages), which returns a CommandBackend. requirement: the package that it needs, as pip reads
    it. system_id: of MAVLink, which it has itself, and no vehicle that it commands may have.
    """

    name: str
    backend: str
    requirement: str
    system_id: int


@dataclass(frozen=True, slots=True)
class VehicleCheck(_Option):
    """A check of the vehicle at a link, by an option of `wil-campaign doctor`.

    name: the option. check: a function of the link, or None, and of the keywords `arm_real`
    (whether arming is consented to), `results` (the folder for them) and `as_json`; it prints what
    it finds and returns the exit code. help: of the option.
    """

    name: str
    check: str
    help: str


@dataclass(frozen=True, slots=True)
class OperatorChannel:
    """A channel beside the socket, by which people follow and command a campaign that flies.

    name: its key of `operator` in a campaign. part: the class of its value, a ChannelPart. open: a
    function of the campaign's controller and of the setup that the part gives; it returns an async
    context manager, in which the channel is open, or raises OperatingError. examine: a function of
    the campaign's file and of the setup, which yields what `doctor` finds; machine: one that yields
    what it finds on this machine without a campaign. summary: what JSON Schemas say of the key.
    """

    name: str
    part: str
    open: str
    examine: str
    machine: str
    summary: str


@dataclass(frozen=True, slots=True)
class RunOption(_Option):
    """An option of `wil-campaign run` that sets a key of the campaign, as --set does.

    name: the option, which takes the value. key: the key, dotted. help: of the option.
    """

    name: str
    key: str
    help: str


@dataclass(frozen=True, slots=True)
class Announcer:
    """What tells others, as the page of a CI job, how a command ended.

    name: one word. problems: a function of the problems for which files were refused, and of the
    warnings about them. verdicts: a function of a campaign that was flown or judged again, of its
    Summary, of the folder of its results, and of the keyword `arm` (False for --no-arm). Both are
    called at the end, also where there is nobody to tell.
    """

    name: str
    problems: str
    verdicts: str


@dataclass(frozen=True, slots=True)
class ProblemFormat(_Option):
    """A format of the faults of files, which `validate` writes by an option, also without any.

    name: the option, which takes a file. text: a function of the problems and of the warnings,
    which returns the file's text. help: of the option. mark: the pattern by which each of its files
    begins: another file is not replaced.
    """

    name: str
    text: str
    help: str
    mark: str = ""


@dataclass(frozen=True, slots=True)
class CaseHints:
    """Warnings of what is valid in the files of a case, but probably not meant; no result has them.

    name: one word. warnings: a function of the case's CaseFiles, of the Case and of the modes that
    are flown, which yields Problems; the case may have problems, too.
    """

    name: str
    warnings: str


@dataclass(frozen=True, slots=True)
class RecordingFormat:
    """A form of other tools in which campaigns have their runs recorded, too (`record.also`).

    name: of the form. trouble: a function that returns why it cannot be written here; "" where it
    can. write: a function of a run's folder, with its recording and its result, and of what has to
    be called now and then; it returns the name of the file that it made there.
    """

    name: str
    trouble: str
    write: str


@dataclass(frozen=True, slots=True)
class AutonomyKind:
    """A kind of autonomy that is no class of Python; it has a runner, or is called as a class is.

    name: its key of `autonomy` in a campaign. value: what the key has, in words. field: as of
    RunObserver. setup: a function of the value, which returns a ForeignAutonomy. runner: a function
    of a run's setup, its pair, a vehicle's context and the run's state, which returns a
    ForeignRunner: it flies the vehicle, in real time. open: in place of it, a function of the same,
    which returns an async context manager: it is entered before anything is armed, and gives an
    OpenedAutonomy, which the run calls as it calls a class, or raises AutonomyFault or
    VehicleError. noun: of it in messages; by default its name.
    """

    name: str
    value: str
    field: str
    setup: str
    runner: str = ""
    open: str = ""
    noun: str = ""


@dataclass(frozen=True, slots=True)
class RunObserver:
    """What takes part in the runs of a campaign that has its key: it receives readings, and sends.

    name: the key, at the top of the file. field: a function that returns the type of its value and
    its default or Field, as `pydantic.create_model` takes them. setup: a function of the value, of
    a case's document and part, and of a list of problems, to which it adds; it returns an
    ObserverSetup, or None for nothing to do. observe: a function of a run's setup, of that, and of
    the world's events by time; it returns an Observer.
    """

    name: str
    field: str
    setup: str
    observe: str


@dataclass(frozen=True, slots=True)
class OracleKind:
    """A kind of oracle, which campaigns name.

    name: in campaigns. spec: an `OracleSpec`, which the decorator `oracle` makes of a factory.
    """

    name: str
    spec: str


@dataclass(frozen=True, slots=True)
class RecipeStep:
    """A step, which recipes name.

    name: in recipes. step: a `StepType`, which the decorator `step` makes of a function; a tuple of
    them for a name in several stages.
    """

    name: str
    step: str


@dataclass(frozen=True, slots=True)
class SensorKind:
    """A type of sensors, which campaigns and recipes name.

    name: in campaigns and recipes. spec: a `SensorSpec`.
    """

    name: str
    spec: str


@dataclass(frozen=True, slots=True)
class AutopilotKind:
    """An autopilot, which campaigns name.

    name: in campaigns. strategy: a class derived from `Autopilot`: its messages, failsafes, fence.
    emulation: one derived from `EmulatedAutopilot`, which flies embedded vehicles. injection: the
    `Rules` by which it acts on messages of `inject`; empty where the plugin injection has them.
    """

    name: str
    strategy: str
    emulation: str
    injection: str = ""

    def __post_init__(self) -> None:
        for each in ("strategy", "emulation"):
            if not getattr(self, each):
                raise ValueError(f"'{self.name}' has no {each}")


@dataclass(frozen=True, slots=True)
class LaunchKind:
    """A launch of an autopilot's own simulation, which the `link` of a vehicle asks for.

    name: of the autopilot. part: the class of the link's keys, a `LaunchPart`.
    """

    name: str
    part: str


@dataclass(frozen=True, slots=True)
class LinkKind:
    """A kind of MAVLink links, as the address in a campaign says it.

    name: the scheme, as "udpin" of udpin://HOST:PORT. at: what its address names, a socket's
    HOST:PORT or a DEVICE:BAUD; empty for nothing. open: a function of a `LinkRequest`
    (vehicles/links/link_factory.py), which returns the Link, not yet entered.
    """

    name: str
    at: Literal["socket", "device", ""]
    open: str


@dataclass(frozen=True, slots=True)
class LinkLayerKind:
    """What the guard leads the links to a vehicle through, as a simulated radio.

    name: the key of campaigns that asks for it. layer: a class derived from `LinkLayer`
    (vehicles/links/link_conditions.py).
    """

    name: str
    layer: str


@dataclass(frozen=True, slots=True)
class ReportSection:
    """A section of the report of a campaign, in front of its runs.

    name: one word. section: a function of the results folder and of what was read of its documents
    (`CampaignDocuments`), which returns a `Section`. It may be called in a process of its own.
    """

    name: str
    section: str


@dataclass(frozen=True, slots=True)
class RunSection:
    """A section of the page of a run in the report, after its images.

    name: one word. section: a function of the results folder and of what was read of the run
    (`RunReport`), which returns a `Section`; of that `html` and `problems` are used. It may be
    called in a process of its own.
    """

    name: str
    section: str


@dataclass(frozen=True, slots=True)
class ReportImage(_Option):
    """A picture of a run, which `wil-campaign report` writes by an option.

    name: the option. write: a function of the results folder and of the run's name ("" for the one
    to show first), which writes the picture and returns its path, or raises ResultsFolderError for
    an unknown run, or one that has nothing to show. help: of the option.
    """

    name: str
    write: str
    help: str


@dataclass(frozen=True, slots=True)
class SensorSource:
    """A source of sensors' readings, by the scheme of the address in a campaign.

    name: the scheme, as "lab" of lab://SHELF. addresses: all of them, in words. open: a function of
    a `SourceRequest`; it returns a `ReadingFile` where `is_file`, else `LiveReadings`, which raise
    SourceError as they are opened. check: a function of the address and of the sensor's type; it
    returns what is wrong with them, or "". is_file: whether it plays at any pace; one that does not
    needs the wall clock.
    """

    name: str
    addresses: str
    open: str
    check: str
    is_file: bool


@dataclass(frozen=True, slots=True)
class ImageSourceKind:
    """A kind of sources of a camera's images, as the address in a campaign says it.

    name: the kind (`SourceKind` of campaigns/values/external_setups.py). open: a function of a
    SourceSetup; of a kind that renders on request with the keywords of `requested_images`
    (orchestrator/external/requested_images.py), which returns RequestedImages, else with the
    keywords `intrinsics`, `side` and `rate_hz`, which returns a CameraSource.
    """

    name: str
    open: str


@dataclass(frozen=True, slots=True)
class MotionCaptureKind:
    """A kind of motion capture, as the address in a campaign says it.

    name: the kind (of MocapSetup, campaigns/values/external_setups.py). open: a function of the
    MocapSetups of one address by vehicle, and of what receives each PoseReading; it returns a
    CaptureInput (orchestrator/external/motion_captures.py).
    """

    name: str
    open: str


@dataclass(frozen=True, slots=True)
class MeshFormat:
    """A format of mesh files, which worlds name.

    name: the suffix of its files, as ".obj". load: a function with the parameters of
    `load_mesh_shape` (worlds/scene/mesh_formats.py), which returns the Shape in a file, or raises
    MeshFileError. named: a function of a file's path, which returns the files that it names.
    """

    name: str
    load: str
    named: str


@dataclass(frozen=True, slots=True)
class Section:
    """What a section of a report shows and says.

    html: its part of the page, with everything from a file escaped; empty for none. problems: what
    is missing or damaged, so that it is left out. files: texts by file name, to be written beside
    the page. text: what `run` prints at its end; empty for nothing.
    """

    html: str = ""
    problems: tuple[str, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    text: str = ""


@dataclass(frozen=True, slots=True)
class Starter:
    """What `wil-campaign init --from` makes a campaign of.

    name: the kind of file. files: a function of the file's path, of the campaign's name and of the
    keyword `profile` (whether a vehicle's profile is asked for, too), which returns the texts of
    the campaign's files by name, "campaign.yaml" among them, or raises BadInput.
    """

    name: str
    files: str


@dataclass(frozen=True, slots=True)
class StarterOption(_Option):
    """An option of `wil-campaign init`, which changes what the template gives.

    name: the option. files: a function of the template's texts by name, which returns those of the
    campaign. help: of the option.
    """

    name: str
    files: str
    help: str


class LiveViewError(Exception):
    """A live view cannot be opened; the message says why, and what to do.

    code: the exit code: 2 for what is found before anything is touched, 3 otherwise.
    """

    code = 3


@_hook
def commands() -> Sequence[Command]:  # type: ignore[empty-body]
    """Return commands of `wil-campaign`."""


@_hook
def campaign_keys() -> Sequence[CampaignKey]:  # type: ignore[empty-body]
    """Return keys of campaign files."""


@_hook
def live_views() -> Sequence[LiveView]:  # type: ignore[empty-body]
    """Return live views beside a flight."""


@_hook
def engines() -> Sequence[Engine]:  # type: ignore[empty-body]
    """Return engines, by which runs fly elsewhere."""


@_hook
def recipe_formats() -> Sequence[RecipeFormat]:  # type: ignore[empty-body]
    """Return formats of recipe files."""


@_hook
def autopilots() -> Sequence[AutopilotKind]:  # type: ignore[empty-body]
    """Return autopilots, which fly vehicles."""


@_hook
def launches() -> Sequence[LaunchKind]:  # type: ignore[empty-body]
    """Return launches of autopilots' own simulations."""


@_hook
def links() -> Sequence[LinkKind]:  # type: ignore[empty-body]
    """Return kinds of MAVLink links."""


@_hook
def link_layers() -> Sequence[LinkLayerKind]:  # type: ignore[empty-body]
    """Return what the links to vehicles are led through."""


@_hook
def image_sources() -> Sequence[ImageSourceKind]:  # type: ignore[empty-body]
    """Return kinds of sources of cameras' images."""


@_hook
def motion_captures() -> Sequence[MotionCaptureKind]:  # type: ignore[empty-body]
    """Return kinds of motion capture."""


@_hook
def mesh_formats() -> Sequence[MeshFormat]:  # type: ignore[empty-body]
    """Return formats of mesh files."""


@_hook
def recipe_steps() -> Sequence[RecipeStep]:  # type: ignore[empty-body]
    """Return steps of recipes."""


@_hook
def sensor_types() -> Sequence[SensorKind]:  # type: ignore[empty-body]
    """Return types of sensors."""


@_hook
def sources() -> Sequence[SensorSource]:  # type: ignore[empty-body]
    """Return sources of sensors' readings."""


@_hook
def drivers() -> Sequence[VehicleDriver]:  # type: ignore[empty-body]
    """Return what sends commands to vehicles in place of our own MAVLink frames."""


@_hook
def vehicle_checks() -> Sequence[VehicleCheck]:  # type: ignore[empty-body]
    """Return checks of a vehicle by `doctor`."""


@_hook
def operator_channels() -> Sequence[OperatorChannel]:  # type: ignore[empty-body]
    """Return channels of operators."""


@_hook
def run_options() -> Sequence[RunOption]:  # type: ignore[empty-body]
    """Return options of `run` that set keys of its campaign."""


@_hook
def autonomy_kinds() -> Sequence[AutonomyKind]:  # type: ignore[empty-body]
    """Return kinds of autonomies other than classes."""


@_hook
def run_observers() -> Sequence[RunObserver]:  # type: ignore[empty-body]
    """Return observers of runs."""


@_hook
def oracles() -> Sequence[OracleKind]:  # type: ignore[empty-body]
    """Return kinds of oracles."""


@_hook
def announcers() -> Sequence[Announcer]:  # type: ignore[empty-body]
    """Return what tells others how a command ended."""


@_hook
def problem_formats() -> Sequence[ProblemFormat]:  # type: ignore[empty-body]
    """Return formats of the faults that `validate` finds."""


@_hook
def case_hints() -> Sequence[CaseHints]:  # type: ignore[empty-body]
    """Return warnings of cases."""


@_hook
def recording_formats() -> Sequence[RecordingFormat]:  # type: ignore[empty-body]
    """Return forms of other tools for recordings, besides run.mcap."""


@_hook
def starters() -> Sequence[Starter]:  # type: ignore[empty-body]
    """Return what campaigns are made of, other than the template."""


@_hook
def starter_options() -> Sequence[StarterOption]:  # type: ignore[empty-body]
    """Return options of `init`."""


@_hook
def report_sections() -> Sequence[ReportSection]:  # type: ignore[empty-body]
    """Return sections of the report of a campaign."""


@_hook
def run_sections() -> Sequence[RunSection]:  # type: ignore[empty-body]
    """Return sections of the page of a run in the report."""


@_hook
def report_images() -> Sequence[ReportImage]:  # type: ignore[empty-body]
    """Return pictures of runs."""
