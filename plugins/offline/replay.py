"""Replays the mixing of a recorded run: the same readings in the same order, by any recipe."""

from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.foundation.files.images import decode_image_file
from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.orchestrator.recording.mcap.mcap_bodies import jpeg_of_image
from wil_campaign.orchestrator.recording.recording_facts import (
    objects_in,
    quality_in,
    recipe_in,
)
from wil_campaign.plugins.offline import recorded_inputs
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.plugins.offline.file_mixing import names_of_mixers
from wil_campaign.plugins.offline.offline_pairing import MixedPair
from wil_campaign.plugins.offline.reading_difference import (
    ReadingDifference,
    difference_of_readings,
)
from wil_campaign.plugins.python.mcap_reader import RecordedProvenance, RecordedReading
from wil_campaign.recipes.model.recipe import Recipe
from wil_campaign.recipes.pipeline.mixture import MixedReading
from wil_campaign.recipes.pipeline.pipeline import Mixer, compile_recipe
from wil_campaign.vehicles.readings import CameraReading, Reading

_MOST_RECENT = 512
"""Readings kept per sensor: a mixture is recorded some periods after its readings."""
_MOST_BYTES = 512 * 1024 * 1024
_COMPARED = ("dropped", "real_seq", "real_t_s", "twin_seq", "skew_ms", "alignment")
"""Not the latency: in a flight it includes the time that the mixing took."""

Key = tuple[str, str]


@dataclass(frozen=True, slots=True)
class ReplayDivergence:
    """A replay's divergence from the recorded mixture. frame: from 0; t_s: of the real reading."""

    frame: int
    t_s: float | None
    difference: ReadingDifference


@dataclass(slots=True)
class ReplayedCombination:
    """The report of one replayed combination.

    frames: mixed again. compared: those that the recording has too. divergences: in order. worst:
    the one with the largest share, with both readings.
    """

    name: str
    frames: int = 0
    mixed: int = 0
    compared: int = 0
    exact: bool = True
    dropped: Mapping[str, int] = field(default_factory=dict)
    divergences: list[ReplayDivergence] = field(default_factory=list)
    worst: tuple[ReplayDivergence, Reading, Reading] | None = None


@dataclass(frozen=True, slots=True)
class ReplayReport:
    """The report of a replay. without: recorded mixtures that the recipe does not make.

    lacks: what the recording lacks, as a sentence; empty when it is whole.
    """

    combinations: tuple[ReplayedCombination, ...]
    without: tuple[str, ...]
    lacks: str = ""

    @property
    def compared(self) -> int:
        """Return how many mixtures of the recording were compared with replayed ones."""
        return sum(combination.compared for combination in self.combinations)

    @property
    def diverges(self) -> bool:
        """Return whether the replay differs from the recording anywhere."""
        return bool(self.without) or any(
            combination.divergences for combination in self.combinations
        )


OnMixture = Callable[[str, MixedPair], None]


def replay_mixing(
    path: Path,
    recipe: Recipe | None = None,
    *,
    trusted: bool = False,
    on_mixture: OnMixture | None = None,
) -> ReplayReport:
    """Replay a recording's mixing and compare. recipe: None for the recorded one.

    trusted: whether code that the recording names may run; a given recipe may always run its own.
    on_mixture: called with each mixture. Raises OfflineError, BadInput, StepError.
    """
    file = recorded_inputs.recording_file(path)
    facts = recorded_inputs.facts_of_recording(file)
    recipe = recipe or _recorded_recipe(file, facts, trusted=trusted)
    objects = objects_in(facts)
    problems = recipe.unknown_objects(frozenset(objects))
    if problems:
        raise BadInput(problems)
    mixers = compile_recipe(recipe, object_ids=objects)
    replaying = _Replay(dict(names_of_mixers(mixers)), on_mixture, quality=quality_in(facts))
    lacks: list[str] = []
    for item in recorded_inputs.recording_items(file, lambda _, what: lacks.append(what)):
        if isinstance(item, RecordedReading):
            replaying.reading(item)
        elif isinstance(item, RecordedProvenance):
            replaying.mixture(item)
    return replaying.report("".join(lacks))


def _recorded_recipe(file: Path, facts: Mapping[str, str], *, trusted: bool) -> Recipe:
    if not facts:
        raise OfflineError(
            f"{file}: has no facts of a run, as a recording that is empty or cut at its beginning; "
            "give a --recipe"
        )
    recipe = recipe_in(facts, loads_code=False)
    if recipe is None:
        raise OfflineError(f"{file}: nothing was mixed in this run; give a --recipe")
    references = recipe.references()
    if not references:
        return recipe
    if not trusted:
        folder = recipe.document.path.parent
        named = ", ".join(printable_problem(str(folder / reference)) for reference in references)
        raise OfflineError(
            f"{file}: the recording names code that would run: {named}; give a recipe of your own "
            "by --recipe, or --trust to run what the recording names"
        )
    return recipe_in(facts, loads_code=True) or recipe


class _Replay:
    """Replays a recording: gives mixers the readings that they got in flight."""

    def __init__(
        self, mixers: Mapping[str, Mixer], on_mixture: OnMixture | None, *, quality: int
    ) -> None:
        self._quality = quality
        self._mixers = mixers
        self._on_mixture = on_mixture
        self._recent: dict[Key, OrderedDict[int, Reading]] = {}
        self._not_offered: dict[str, deque[Reading]] = {name: deque() for name in mixers}
        self._inexact: set[Key] = set()
        self._recorded: dict[str, tuple[Reading, bool]] = {}
        self._replayed = {name: ReplayedCombination(name) for name in mixers}
        self._without: Counter[str] = Counter()

    def reading(self, item: RecordedReading) -> None:
        reading = item.reading
        if reading.source == "mixed":
            self._recorded[item.sensor] = (reading, item.exact)
            return
        key = (reading.source, item.sensor)
        if not item.exact:
            self._inexact.add(key)
        recent = self._recent.setdefault(key, OrderedDict())
        recent[reading.seq] = reading
        while len(recent) > _most(reading):
            recent.popitem(last=False)
        for name, mixer in self._mixers.items():
            if mixer.sensor != item.sensor:
                continue
            if reading.source == "real":
                waiting = self._not_offered[name]
                waiting.append(reading)
                if len(waiting) > _most(reading):
                    mixer.offer("real", waiting.popleft())
            elif mixer.pose_request is None:
                mixer.offer("twin", reading)

    def mixture(self, item: RecordedProvenance) -> None:
        """Repeat a recorded mixture, and compare the result with the recording."""
        recorded = self._recorded.pop(item.sensor, None)
        names = [name for name in self._mixers if _is_of(name, item.sensor)]
        if not names:
            self._without[item.sensor] += 1
        for name in names:
            self._mix(name, self._mixers[name], item.fields, recorded)

    def report(self, lacks: str) -> ReplayReport:
        """Return the replay's report of all combinations. lacks: of the recording."""
        for name, mixer in self._mixers.items():
            counts = mixer.counts()
            self._replayed[name].mixed = counts.mixed
            self._replayed[name].dropped = dict(counts.dropped)
        return ReplayReport(tuple(self._replayed.values()), tuple(self._without), lacks)

    def _mix(
        self,
        name: str,
        mixer: Mixer,
        provenance: Mapping[str, Any],
        recorded: tuple[Reading, bool] | None,
    ) -> None:
        real = self._recorded_input("real", mixer.sensor, provenance.get("given_real_seq"))
        twin = self._recorded_input("twin", mixer.sensor, provenance.get("given_twin_seq"))
        self._offer_readings_before(real, name, mixer)
        mixed: MixedReading[Reading] = mixer.mix(
            real, twin, now_s=provenance["mixed_s"], alignment=provenance["alignment"]
        )
        replayed = self._replayed[name]
        frame = replayed.frames
        replayed.frames += 1
        if real is not None and self._on_mixture is not None:
            self._on_mixture(name, MixedPair(real, twin, mixed))
        self._compare(replayed, frame, mixed, provenance, recorded)

    def _offer_readings_before(self, mixed: Reading | None, name: str, mixer: Mixer) -> None:
        """Offer the real readings that came before the one to be mixed, as the flight did.

        Those that came after it wait: a step that selects by time sees all in their order.
        """
        waiting = self._not_offered[name]
        if all(one is not mixed for one in waiting):
            return
        while (reading := waiting.popleft()) is not mixed:
            mixer.offer("real", reading)

    def _recorded_input(self, source: str, sensor: str, seq: int | None) -> Reading | None:
        recent = self._recent.get((source, sensor))
        return None if seq is None or recent is None else recent.get(seq)

    def _compare(
        self,
        replayed: ReplayedCombination,
        frame: int,
        mixed: MixedReading[Reading],
        provenance: Mapping[str, Any],
        recorded: tuple[Reading, bool] | None,
    ) -> None:
        t_s = provenance.get("real_t_s")
        replayed.compared += 1
        for key in _COMPARED:
            again, before = getattr(mixed.provenance, key), provenance.get(key)
            if again != before:
                what = f"{key} is {again!r} instead of {before!r}"
                replayed.divergences.append(ReplayDivergence(frame, t_s, ReadingDifference(what)))
                return
        if recorded is None or mixed.reading is None:
            if (recorded is None) != (mixed.reading is None):
                what = "a mixture that was not recorded" if recorded is None else "no mixture"
                replayed.divergences.append(ReplayDivergence(frame, t_s, ReadingDifference(what)))
            return
        reading, exact = recorded
        sensor = mixed.reading.sensor
        has_exact_inputs = not self._inexact & {("real", sensor), ("twin", sensor)}
        again = mixed.reading
        if has_exact_inputs and not exact:
            again = _as_jpeg(again, self._quality)
        found = difference_of_readings(reading, again, exact=True) if has_exact_inputs else None
        if found is not None or not has_exact_inputs:
            # JPEG differs from library to library, by less than its loss.
            found = difference_of_readings(reading, again, exact=exact and has_exact_inputs)
            replayed.exact = False
        if found is None:
            return
        diverging = ReplayDivergence(frame, t_s, found)
        replayed.divergences.append(diverging)
        if replayed.worst is None or found.share > replayed.worst[0].difference.share:
            replayed.worst = (diverging, reading, mixed.reading)


def _as_jpeg(reading: Reading, quality: int) -> Reading:
    """Return a camera's image as its recording as JPEG would read; any other reading itself."""
    if not isinstance(reading, CameraReading):
        return reading
    return replace(reading, image_bgr=decode_image_file(jpeg_of_image(reading.image_bgr, quality)))


def _most(reading: Reading) -> int:
    """Return how many readings of this size the replay keeps."""
    size = getattr(getattr(reading, "image_bgr", None), "nbytes", 0)
    size += getattr(getattr(reading, "depth_m", None), "nbytes", 0)
    return min(_MOST_RECENT, max(8, _MOST_BYTES // (size + 1024) // 4))


def _is_of(name: str, recorded: str) -> bool:
    """Return whether a replayed combination corresponds to a recorded one.

    A combination for both vehicles is compared with those for each of them.
    """
    sensor, of_recorded = name.partition(".")[0], recorded.partition(".")[0]
    return recorded in (name, sensor) or of_recorded == name
