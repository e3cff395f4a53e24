"""A recorded run mixed anew: the same readings in the same order, by any recipe."""

from collections import Counter, OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from orchestrator.offline import recorded_inputs
from orchestrator.offline.errors import OfflineError
from orchestrator.offline.file_mixing import names_of
from orchestrator.offline.offline_pairing import MixedPair
from orchestrator.offline.reading_difference import Difference, difference
from orchestrator.recording.mcap_reader import RecordedProvenance, RecordedReading
from orchestrator.recording.recording_facts import objects_in, recipe_in
from recipes.model.recipe import Recipe
from recipes.pipeline.mixture import Mixed
from recipes.pipeline.pipeline import Mixer, compile_recipe
from vehicles.readings import Reading
from worlds.files.documents import BadInput
from worlds.files.problems import printable

_KEPT = 512
"""Readings of a sensor that may still be mixed; a mixture comes some periods after its readings."""
_KEPT_BYTES = 512 * 1024 * 1024
_COMPARED = ("dropped", "real_seq", "twin_seq", "skew_ms", "latency_ms", "alignment")

Key = tuple[str, str]


@dataclass(frozen=True, slots=True)
class Divergence:
    """A replay's divergence from the recorded mixture. frame: from 0; t_s: of the real reading."""

    frame: int
    t_s: float | None
    difference: Difference


@dataclass(slots=True)
class Replayed:
    """The report of one replayed combination.

    frames: mixed again. compared: of them those that the recording has too. divergences: all of
    them, in order. worst: that with the largest share, with both readings.
    """

    name: str
    frames: int = 0
    mixed: int = 0
    compared: int = 0
    exact: bool = True
    dropped: Mapping[str, int] = field(default_factory=dict)
    divergences: list[Divergence] = field(default_factory=list)
    worst: tuple[Divergence, Reading, Reading] | None = None


@dataclass(frozen=True, slots=True)
class ReplayReport:
    """The report of a replay. without: recorded mixtures that the recipe does not make."""

    combinations: tuple[Replayed, ...]
    without: tuple[str, ...]

    @property
    def diverges(self) -> bool:
        """Return whether the replay differs from the recording anywhere."""
        return bool(self.without) or any(one.divergences for one in self.combinations)


Tell = Callable[[str, MixedPair], None]


def _ignore_progress(name: str, pair: MixedPair) -> None:
    """Ignore a replayed mixture: no output is wanted."""
    del name, pair


def replay(
    path: Path,
    recipe: Recipe | None = None,
    *,
    trusted: bool = False,
    tell: Tell = _ignore_progress,
) -> ReplayReport:
    """Replay a recording's mixing and compare. recipe: None for the recorded one.

    trusted: whether code that the recording names may run; a recipe that is given may run its own.
    tell: takes each mixture. Raises OfflineError, BadInput, StepError.
    """
    file = recorded_inputs.recording_file(path)
    facts = recorded_inputs.facts_of_recording(file)
    recipe = recipe or _recorded_recipe(file, facts, trusted=trusted)
    objects = objects_in(facts)
    problems = recipe.unknown_objects(frozenset(objects))
    if problems:
        raise BadInput(problems)
    mixers = compile_recipe(recipe, object_ids=objects)
    anew = _Replay(dict(names_of(mixers)), tell)
    for item in recorded_inputs.items(file):
        if isinstance(item, RecordedReading):
            anew.reading(item)
        elif isinstance(item, RecordedProvenance):
            anew.mixture(item)
    return anew.report()


def _recorded_recipe(file: Path, facts: Mapping[str, str], *, trusted: bool) -> Recipe:
    """Return the recipe in a recording. Raises OfflineError for code that is not trusted."""
    recipe = recipe_in(facts, loads_code=False)
    if recipe is None:
        raise OfflineError(f"{file}: nothing was mixed in this run; give a --recipe")
    references = recipe.references()
    if not references:
        return recipe
    if not trusted:
        folder = recipe.document.path.parent
        named = ", ".join(printable(str(folder / reference)) for reference in references)
        raise OfflineError(
            f"{file}: the recording names code that would run: {named}; give a recipe of your own "
            "by --recipe, or --trust to run what the recording names"
        )
    return recipe_in(facts, loads_code=True) or recipe


class _Replay:
    """Replays a recording: gives mixers what they got in flight."""

    def __init__(self, mixers: Mapping[str, Mixer], tell: Tell) -> None:
        self._mixers = mixers
        self._tell = tell
        self._kept: dict[Key, OrderedDict[int, Reading]] = {}
        self._inexact: set[Key] = set()
        self._recorded: dict[str, tuple[Reading, bool]] = {}
        self._replayed = {name: Replayed(name) for name in mixers}
        self._without: Counter[str] = Counter()

    def reading(self, item: RecordedReading) -> None:
        """Take a recorded reading for the replay."""
        reading = item.reading
        if reading.source == "mixed":
            self._recorded[item.sensor] = (reading, item.exact)
            return
        key = (reading.source, item.sensor)
        if not item.exact:
            self._inexact.add(key)
        kept = self._kept.setdefault(key, OrderedDict())
        kept[reading.seq] = reading
        while len(kept) > _most(reading):
            kept.popitem(last=False)
        if reading.source == "twin":
            for mixer in self._mixers.values():
                if mixer.sensor == item.sensor and mixer.pose_request is None:
                    mixer.offer("twin", reading)

    def mixture(self, item: RecordedProvenance) -> None:
        """Mix again what was mixed here in flight, and compare with the recording."""
        told = item.fields
        recorded = self._recorded.pop(item.sensor, None)
        names = [name for name in self._mixers if _is_of(name, item.sensor)]
        if not names:
            self._without[item.sensor] += 1
        for name in names:
            self._mix(name, self._mixers[name], told, recorded)

    def report(self) -> ReplayReport:
        """Return the replay's report of all combinations."""
        for name, mixer in self._mixers.items():
            counts = mixer.counts()
            self._replayed[name].mixed = counts.mixed
            self._replayed[name].dropped = dict(counts.dropped)
        return ReplayReport(tuple(self._replayed.values()), tuple(self._without))

    def _mix(
        self,
        name: str,
        mixer: Mixer,
        told: Mapping[str, Any],
        recorded: tuple[Reading, bool] | None,
    ) -> None:
        real = self._record_input("real", mixer.sensor, told.get("given_real_seq"))
        twin = self._record_input("twin", mixer.sensor, told.get("given_twin_seq"))
        mixed: Mixed[Reading] = mixer.mix(
            real, twin, now_s=told["mixed_s"], alignment=told["alignment"]
        )
        replayed = self._replayed[name]
        frame = replayed.frames
        replayed.frames += 1
        if real is not None:
            self._tell(name, MixedPair(real, twin, mixed))
        self._compare(replayed, frame, mixed, told, recorded)

    def _record_input(self, source: str, sensor: str, seq: int | None) -> Reading | None:
        kept = self._kept.get((source, sensor))
        return None if seq is None or kept is None else kept.get(seq)

    def _compare(
        self,
        replayed: Replayed,
        frame: int,
        mixed: Mixed[Reading],
        told: Mapping[str, Any],
        recorded: tuple[Reading, bool] | None,
    ) -> None:
        t_s = told.get("real_t_s")
        replayed.compared += 1
        for key in _COMPARED:
            again, before = getattr(mixed.provenance, key), told.get(key)
            if again != before:
                said = f"{key} is {again!r} instead of {before!r}"
                replayed.divergences.append(Divergence(frame, t_s, Difference(said)))
                return
        if recorded is None or mixed.reading is None:
            if (recorded is None) != (mixed.reading is None):
                said = "a mixture where there was none" if recorded is None else "no mixture"
                replayed.divergences.append(Divergence(frame, t_s, Difference(said)))
            return
        reading, exact = recorded
        sensor = mixed.reading.sensor
        exact = exact and not self._inexact & {("real", sensor), ("twin", sensor)}
        replayed.exact = replayed.exact and exact
        found = difference(reading, mixed.reading, exact=exact)
        if found is None:
            return
        diverging = Divergence(frame, t_s, found)
        replayed.divergences.append(diverging)
        if replayed.worst is None or found.share > replayed.worst[0].difference.share:
            replayed.worst = (diverging, reading, mixed.reading)


def _most(reading: Reading) -> int:
    """Return how many readings like this one the replay keeps."""
    size = getattr(getattr(reading, "image_bgr", None), "nbytes", 0)
    size += getattr(getattr(reading, "depth_m", None), "nbytes", 0)
    return min(_KEPT, max(8, _KEPT_BYTES // (size + 1024) // 4))


def _is_of(name: str, recorded: str) -> bool:
    """Return whether a replayed combination corresponds to a recorded one.

    A sensor mixed for both vehicles alike in one recipe is compared with each one's in another.
    """
    sensor, of_recorded = name.partition(".")[0], recorded.partition(".")[0]
    return recorded in (name, sensor) or of_recorded == name
