"""Mixes files by a recipe: `wil-campaign mix`."""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path

from wil_campaign.foundation.files.documents import BadInput, load_document
from wil_campaign.foundation.files.paths import is_folder
from wil_campaign.orchestrator.recording.recording_facts import objects_in
from wil_campaign.orchestrator.recording.timestamps import VIRTUAL_EPOCH_S
from wil_campaign.plugins.offline import image_inputs, recorded_inputs
from wil_campaign.plugins.offline.contact_sheet import ContactSheet
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.plugins.offline.image_inputs import InputFileOptics, WorldCamera, input_kind_of
from wil_campaign.plugins.offline.mixture_outputs import (
    MixtureOutput,
    output_for_file,
    refuse_file_of_run,
    write_mixture_image,
)
from wil_campaign.plugins.offline.offline_pairing import (
    RenderedTwinPairing,
    SingleTwinPairing,
    StreamedTwinPairing,
    TwinPairing,
    paired_mixtures,
)
from wil_campaign.recipes.model.recipe import Recipe
from wil_campaign.recipes.pipeline.pipeline import Mixer, compile_recipe
from wil_campaign.vehicles.readings import CameraReading, Reading, Source
from wil_campaign.vehicles.sources.camera_source import IMAGE_SUFFIXES
from wil_campaign.worlds.frames import AT_ORIGIN, Pose
from wil_campaign.worlds.world_file.world import World

_VIDEO_HZ = 30.0
"""Nominal rate of a mixed video, for its key frames; each frame has its own time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SideFiles:
    """The input files of one side. fov_deg: of its camera, where the file does not have it."""

    file: Path
    fov_deg: float = 69.0
    depth: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MixOrder:
    """The files to mix. sensor: None for the recipe's first camera, or for all recorded.

    place: of the camera where the twin is a world; by default its origin. stages: the file
    for the contact sheet of mixture number `frame`.
    """

    recipe: Recipe
    real: SideFiles
    twin: SideFiles
    out: Path
    sensor: str | None = None
    place: Pose | None = None
    stages: Path | None = None
    frame: int = 0


@dataclass(frozen=True, slots=True)
class CombinationReport:
    """The report of one combination mixed from files.

    reasons: the first of each kind. lacks: what the recordings lack, in words, each with its file.
    """

    name: str
    frames: int
    mixed: int
    dropped: Mapping[str, int]
    faults: Mapping[str, int]
    reasons: tuple[str, ...]
    lacks: tuple[str, ...] = ()

    @property
    def complete(self) -> bool:
        """Return whether there are frames, all of them were mixed, and no input lacks any."""
        return self.frames > 0 and self.mixed == self.frames and not self.lacks


def mix_files(order: MixOrder) -> tuple[CombinationReport, ...]:
    """Mix files and write the outputs; return a report of each combination.

    Raises OfflineError, BadInput, StepError, OSError.
    """
    _refuse_to_overwrite(order)
    sheet = ContactSheet(frame=order.frame) if order.stages is not None else None
    inputs = _Inputs(order)
    _refuse_unknown_objects(order.recipe, inputs.objects)
    mixers = compile_recipe(order.recipe, object_ids=inputs.objects, observer=sheet)
    chosen = _choose_names(mixers, order)
    with ExitStack() as stack:
        output = output_for_file(order.out, rate_hz=_VIDEO_HZ, epoch_s=VIRTUAL_EPOCH_S)
        output = stack.enter_context(output)
        reports = tuple(_mix_pairs(name, mixer, inputs, output) for name, mixer in chosen)
    if sheet is not None and order.stages is not None:
        if sheet.is_empty:
            raise OfflineError(f"{order.stages}: there is no frame {order.frame} to show")
        write_mixture_image(order.stages, sheet.draw())
    return reports


def _refuse_to_overwrite(order: MixOrder) -> None:
    """Raise OfflineError when an output of the mixing is an input, or a file of a run."""
    named = (order.real.file, order.twin.file, order.real.depth, order.twin.depth)
    inputs = [file for file in named if file is not None]
    inputs += [file / "run.mcap" for file in inputs if is_folder(file)]
    taken = {file.resolve() for file in inputs}
    for written in (order.out, order.stages):
        if written is None:
            continue
        if written.resolve() in taken:
            raise OfflineError(f"{written}: is an input file; write to another file")
        refuse_file_of_run(written)
    if order.stages is not None and order.stages.resolve() == order.out.resolve():
        raise OfflineError(f"{order.stages}: is the mixture's file; write to another file")
    if order.stages is not None and order.stages.suffix.lower() not in IMAGE_SUFFIXES:
        raise OfflineError(f"{order.stages}: name an image (.png)")


def _refuse_unknown_objects(recipe: Recipe, objects: Mapping[str, int]) -> None:
    """Raise OfflineError for objects of the recipe that the twin's file lacks."""
    problems = recipe.unknown_objects(frozenset(objects))
    if problems and not objects:
        raise OfflineError(
            f"{recipe.document.name}: keeps objects by name, but an image has no object names; "
            "give a world file or a recording as --twin"
        )
    if problems:
        raise BadInput(problems)


def _choose_names(mixers: tuple[Mixer, ...], order: MixOrder) -> tuple[tuple[str, Mixer], ...]:
    """Return the wanted mixers of a recipe, each with its unique name."""
    recorded = input_kind_of(order.real.file) == "recording"
    found = [mixer for mixer in mixers if order.sensor in (None, mixer.sensor)]
    if not recorded or order.out.suffix.lower() != ".mcap":
        found = [mixer for mixer in found if mixer.combination.sensor.kind == "camera"][:1]
    if not found:
        wanted = f"no sensor '{order.sensor}'" if order.sensor else "no camera"
        kinds = {mixer.sensor: mixer.combination.sensor.kind for mixer in mixers}
        if kind := kinds.get(order.sensor or ""):
            wanted = f"'{order.sensor}', a {kind}, from recordings into an .mcap alone, no camera"
        raise OfflineError(f"{order.recipe.document.name}: combines {wanted} for {order.out.name}")
    return tuple(names_of_mixers(found))


def names_of_mixers(mixers: "list[Mixer] | tuple[Mixer, ...]") -> Iterator[tuple[str, Mixer]]:
    """Yield each mixer with its name: the sensor, and its receivers if several share it."""
    sensors = [mixer.sensor for mixer in mixers]
    for mixer in mixers:
        several = sensors.count(mixer.sensor) > 1
        yield (f"{mixer.sensor}.{'_'.join(mixer.publish)}" if several else mixer.sensor), mixer


def _mix_pairs(
    name: str, mixer: Mixer, inputs: "_Inputs", output: MixtureOutput
) -> CombinationReport:
    twins = inputs.twins(mixer)
    reasons: dict[str, str] = {}
    for pair in paired_mixtures(mixer, inputs.reals(mixer), twins):
        provenance = pair.mixed.provenance
        if provenance.dropped is not None:
            reasons.setdefault(provenance.dropped, provenance.detail)
        output.receive(name, pair)
    counts = mixer.counts()
    lacks = tuple(f"{file}: {what}" for file, what in inputs.lacking.items())
    refused = twins.faults[:1] if isinstance(twins, StreamedTwinPairing) else []
    return CombinationReport(
        name=name,
        frames=counts.frames,
        mixed=counts.mixed,
        dropped=dict(counts.dropped),
        faults=dict(counts.faults),
        reasons=(*reasons.values(), *refused, *lacks),
        lacks=lacks,
    )


class _Inputs:
    """Opens the input files of a mix order; each call reads them again."""

    def __init__(self, order: MixOrder) -> None:
        self._order = order
        self.lacking: dict[Path, str] = {}
        """What a recording lacks, by its file, as far as it was read to its end."""
        self._kinds = (input_kind_of(order.real.file), input_kind_of(order.twin.file))
        real, twin = self._kinds
        if real == "world":
            raise OfflineError(
                f"{order.real.file}: is a world; the real side needs an image, a video "
                "or a recording"
            )
        if (real == "recording") != (twin == "recording"):
            raise OfflineError(
                "a recording can only be mixed with a recording: give recordings for both sides"
            )
        if (real, twin) == ("image", "video"):
            raise OfflineError(
                "the real side is an image and the twin's a video: give two images or two videos"
            )
        for option, given, kind, kinds in (
            ("--place", order.place, twin, {"image", "video", "recording"}),
            ("--twin-depth", order.twin.depth, twin, {"world", "recording"}),
            ("--real-depth", order.real.depth, real, {"recording"}),
        ):
            if given is not None and kind in kinds:
                raise OfflineError(f"{option}: has no effect on this kind of input, {kind}")
        self._world = World.parse(load_document(order.twin.file)) if twin == "world" else None
        self.objects: Mapping[str, int] = {}
        if self._world is not None:
            objects = self._world.scene("wil", "Wv").objects
            self.objects = {obj.name: obj.object_id for obj in objects}
        elif twin == "recording":
            file = recorded_inputs.recording_file(order.twin.file)
            self.objects = objects_in(recorded_inputs.facts_of_recording(file))

    def reals(self, mixer: Mixer) -> Iterator[Reading]:
        side = self._order.real
        if self._kinds[0] == "recording":
            return self._recorded(side.file, "real", mixer.sensor)
        return _image_inputs(side, self._kinds[0] == "image", "real")

    def twins(self, mixer: Mixer) -> TwinPairing:
        side, kind = self._order.twin, self._kinds[1]
        if kind == "recording":
            found = self._recorded(side.file, "twin", mixer.sensor)
            return StreamedTwinPairing(found, partial(mixer.offer, "twin"))
        if self._world is not None:
            optics = InputFileOptics(side.fov_deg)
            pose = self._order.place or AT_ORIGIN
            camera = WorldCamera(world=self._world, pose=pose, optics=optics)
            return RenderedTwinPairing(camera.reading)
        if kind == "image":
            return SingleTwinPairing(next(_image_inputs(side, True, "twin")))
        return StreamedTwinPairing(_image_inputs(side, False, "twin"), partial(mixer.offer, "twin"))

    def _recorded(self, path: Path, source: Source, sensor: str) -> Iterator[Reading]:
        file = recorded_inputs.recording_file(path)
        found = recorded_inputs.recorded_sensor_readings(
            file, source, sensor, self.lacking.__setitem__
        )
        first = next(found, None)
        if first is None:
            lacks = f"; {self.lacking[file]}" if file in self.lacking else ""
            raise OfflineError(f"{file}: has no reading of sensor '{sensor}' of {source}{lacks}")
        return chain([first], found)


def _image_inputs(side: SideFiles, one: bool, source: Source) -> Iterator[CameraReading]:
    optics = InputFileOptics(side.fov_deg)
    found: Iterator[CameraReading] = (
        iter([image_inputs.read_image_reading(side.file, source, optics)])
        if one
        else image_inputs.read_video_readings(side.file, source, optics)
    )
    if side.depth is None:
        return found
    depth_m, path = image_inputs.read_depth_file(side.depth), side.depth
    return (image_inputs.reading_with_depth(reading, depth_m, path) for reading in found)
