"""Visibility coverage of a run: how often its mixtures showed each virtual object. Pure."""

from array import array
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from wil_campaign.recipes.visibility.model import FrameVisibility, ObjectVisibility, Unit
from wil_campaign.recipes.visibility.ranges import BLIND_WITHIN_M
from wil_campaign.worlds.figures import distinct_value_text

_SHARE_FRAMES = 5
"""Least number of measured frames for a share: with fewer, one frame at the edge of the image would
decide it."""
_BLIND_S = 2.0
"""How long an object may be in view without being shown before the flight is ended."""
_LEAST_SHARE = 0.5
"""Least share of the frames with an object in view that have to show it."""
_MOST_DISPLACED = 1 / 3
"""Largest share of the frames with an object in view that may show it displaced."""
_IN_A_ROW = 2
"""Number of wrong frames in a row that make a fault. In a single one, an object that crosses the
edge of the image may look displaced or missing."""


@dataclass(slots=True)
class ObjectCoverage:
    """The coverage of one object. in_view, shown: frames. offsets: of shown ones, in `unit`.

    displaced, missed: latest frames in a row. missed_s: when these began to be missed. due: frames
    in view but for those that only confirm a wrong one; due_shown, due_displaced: of these. Shares
    are of these: with all, what two of five frames show by turns would be shown in half of them.
    """

    unit: Unit = "px"
    in_view: int = 0
    shown: int = 0
    offsets: "array[float]" = field(default_factory=lambda: array("d"))
    first_in_view_s: float | None = None
    last_in_view_s: float | None = None
    displaced: int = 0
    missed: int = 0
    missed_s: float = 0.0
    due: int = 0
    due_shown: int = 0
    due_displaced: int = 0

    @property
    def is_covered(self) -> bool:
        """Return whether enough of the frames with the object in view show it."""
        return self.shown > 0 and self.due_shown >= _LEAST_SHARE * self.due

    def is_lost(self, t_s: float) -> bool:
        """Return whether the object was shown, and is not any more for long enough.

        One that was shown in few frames may be what another combination shows.
        """
        return (
            self.shown >= _SHARE_FRAMES
            and self.missed >= _SHARE_FRAMES
            and t_s - self.missed_s >= _BLIND_S
        )

    @property
    def is_often_displaced(self) -> bool:
        """Return whether too many of the frames with the object in view show it displaced.

        These need not be in a row, as when every second image is late.
        """
        return self.in_view >= _SHARE_FRAMES and self.due_displaced > _MOST_DISPLACED * self.due


@dataclass(frozen=True, slots=True)
class VisibilityFault:
    """An object that mixtures fail to show. t_s: the first such exposure, run clock."""

    t_s: float
    text: str


class VisibilityCoverage:
    """The coverage of virtual objects by one combination's mixtures while the goal is flown.

    frames: number of measured ones. not_mixed: objects that the combination leaves out by name,
    each with the number of measured frames in which it was in view. shower: what shows the objects,
    as named in faults.
    """

    def __init__(self, shower: str = "the mixture") -> None:
        self._shower = shower
        self.frames = 0
        self.objects: dict[str, ObjectCoverage] = {}
        self.not_mixed: Counter[str] = Counter()
        self._not_measured = ""
        self._unexpected = 0
        self._blind_s: float | None = None
        self._blind_frames = 0
        """Since when no frame in a row shows anything that is in view, and how many these are."""
        self._unseeing_s: float | None = None
        self._unseeing_frames = 0
        """Since when the real reading of no frame in a row has a surface, and how many."""

    def observe(self, frame: FrameVisibility) -> VisibilityFault | None:
        """Count a measured mixture; return the visibility fault once it has lasted long enough."""
        if frame.not_measured:
            self._not_measured = frame.not_measured
            return None
        self.frames += 1
        self.not_mixed.update(frame.not_mixed)
        self._unexpected = self._unexpected + 1 if frame.is_unexpected else 0
        faults = [self._observe(visibility, frame) for visibility in frame.objects]
        if self._unexpected >= _IN_A_ROW:
            share = f"{frame.elsewhere * 100:.1f} % of the reading"
            extra = (
                f"something virtual in {share} at {frame.t_s:.3f} s, where geometry expects nothing"
            )
            faults.append(VisibilityFault(frame.t_s, f"{self._shower} shows {extra}"))
        faults += [
            self._lasting_blindness(),
            self._lost_from_view(frame),
            self._one_lost_from_view(frame),
            self._without_real_surfaces(frame),
        ]
        return next((fault for fault in faults if fault is not None), None)

    def why_not_measured(self) -> str:
        """Return why some or all mixtures were not measured; "" when all were."""
        if self.frames or self._not_measured:
            return self._not_measured
        return "no mixture was made while the goal was flown"

    def is_suspect(self) -> bool:
        """Return whether the last mixture was wrong, so that the next one has to confirm it.

        It missed an object in view, displaced one, or showed something where nothing is expected.
        Two in a row confirm it. An object that stays missed is then measured at the usual rate.
        """
        if self._unexpected:
            return True
        return any(
            coverage.missed < _IN_A_ROW and (coverage.displaced or coverage.missed)
            for coverage in self.objects.values()
        )

    def is_due(self, one: ObjectCoverage) -> bool:
        """Return whether an object that no frame shows was in view often enough to be a fault.

        That is in two measured frames, or in the only one.
        """
        return one.in_view >= min(_IN_A_ROW, max(1, self.frames))

    def never_shown(self) -> VisibilityFault | None:
        """Return the fault of a combination that shows no object in view; None without one."""
        due = [name for name, coverage in self.objects.items() if coverage.in_view >= _SHARE_FRAMES]
        if not due or any(coverage.shown for coverage in self.objects.values()):
            return None
        return never_shown_fault({name: [self.objects[name]] for name in due}, shower=self._shower)

    def _observe(self, one: ObjectVisibility, frame: FrameVisibility) -> VisibilityFault | None:
        t_s = frame.t_s
        known = self.objects.setdefault(one.name, ObjectCoverage(one.unit))
        if not one.in_view:
            known.displaced = known.missed = 0
            return None
        known.in_view += 1
        known.missed_s = known.missed_s if known.missed else t_s
        known.missed = 0 if one.is_shown else known.missed + 1
        known.shown += one.is_shown
        if not frame.confirms:
            known.due += 1
            known.due_shown += one.is_shown
            known.due_displaced += one.is_displaced
        known.last_in_view_s = t_s
        if known.first_in_view_s is None:
            known.first_in_view_s = t_s
        if one.offset is None:
            return None
        known.offsets.append(one.offset)
        known.displaced = known.displaced + 1 if one.is_displaced else 0
        if not one.is_displaced or not (known.displaced >= _IN_A_ROW or known.is_often_displaced):
            return None
        digits = 0 if one.unit == "px" else 2
        offset = distinct_value_text(one.offset, float(f"{one.limit:.3g}"), digits=digits)
        off = f"{offset} {one.unit} from its place at {t_s:.3f} s"
        off = f"in the place of {one.place_of}, {off}" if one.place_of else off
        text = f"{self._shower} shows {one.name} {off}; the limit is {one.limit:.3g} {one.unit}"
        return VisibilityFault(t_s, text)

    def _lost_from_view(self, frame: FrameVisibility) -> VisibilityFault | None:
        """Return the fault that objects which were shown are not any more, for long enough.

        Others may be what another combination shows.
        """
        names = [one.name for one in frame.objects if one.in_view and self.objects[one.name].shown]
        if not names or any(one.is_shown for one in frame.objects):
            self._blind_s, self._blind_frames = None, 0
            return None
        self._blind_s = frame.t_s if self._blind_s is None else self._blind_s
        self._blind_frames += 1
        if self._blind_frames < _SHARE_FRAMES or frame.t_s - self._blind_s < _BLIND_S:
            return None
        return self._loss_fault(names, self._blind_s, self._blind_frames)

    def _one_lost_from_view(self, frame: FrameVisibility) -> VisibilityFault | None:
        """Return the fault that an object is lost while others in view are shown."""
        for one in frame.objects:
            known = self.objects[one.name]
            if known.is_lost(frame.t_s):
                return self._loss_fault([one.name], known.missed_s, known.missed)
        return None

    def _loss_fault(self, names: Iterable[str], since_s: float, frames: int) -> VisibilityFault:
        text = f"does not show {' and '.join(names)} any more from {since_s:.3f} s on, though "
        text += f"in view in {frames} measured frames in a row"
        return VisibilityFault(since_s, f"{self._shower} {text}")

    def _without_real_surfaces(self, frame: FrameVisibility) -> VisibilityFault | None:
        """Return the fault that the real sensor saw nothing of the real world for long enough."""
        if not frame.is_blind:
            self._unseeing_s, self._unseeing_frames = None, 0
            return None
        since_s = self._unseeing_s = frame.t_s if self._unseeing_s is None else self._unseeing_s
        self._unseeing_frames += 1
        if self._unseeing_frames < _SHARE_FRAMES or frame.t_s - since_s < _BLIND_S:
            return None
        text = f"has nothing of the real sensor from {since_s:.3f} s on, though surfaces of the "
        text += f"real world are within {BLIND_WITHIN_M:g} m of it: it is covered or broken"
        return VisibilityFault(since_s, f"{self._shower} {text}")

    def _lasting_blindness(self) -> VisibilityFault | None:
        """Return the fault that nothing in view was shown, once it has lasted long enough."""
        fault = self.never_shown()
        if fault is None:
            return None
        due = [coverage for coverage in self.objects.values() if coverage.in_view >= _SHARE_FRAMES]
        lasted = [
            (coverage.last_in_view_s or 0.0) - (coverage.first_in_view_s or 0.0) for coverage in due
        ]
        return fault if max(lasted) >= _BLIND_S else None


def never_shown_fault(
    objects: dict[str, list[ObjectCoverage]], *, shower: str = "the mixture"
) -> VisibilityFault:
    """Return the coverage fault of objects that no mixture, or too few, showed."""
    details = []
    for name, each in objects.items():
        best = max(each, key=lambda one: one.in_view)
        frames, shown = (best.due, best.due_shown) if best.shown else (best.in_view, 0)
        details.append(f"{name}: it was in view in {frames} measured frames, {shown} showed it")
    word = (
        "never"
        if not any(coverage.shown for each in objects.values() for coverage in each)
        else "hardly"
    )
    times = [coverage.first_in_view_s or 0.0 for each in objects.values() for coverage in each]
    return VisibilityFault(min(times), f"{shower} {word} showed {'; '.join(details)}")


def uncovered_objects(
    combinations: Iterable[VisibilityCoverage], *, shower: str = "the mixture"
) -> VisibilityFault | None:
    """Return the objects without coverage by any combination in which they were in view.

    A lidar may show an object that a camera's recipe leaves out, and the other way round.
    """
    each: dict[str, list[tuple[VisibilityCoverage, ObjectCoverage]]] = {}
    for coverage in combinations:
        for name, one in coverage.objects.items():
            each.setdefault(name, []).append((coverage, one))
    bad = {name: [one for _, one in seen] for name, seen in each.items() if _is_uncovered(seen)}
    return never_shown_fault(bad, shower=shower) if bad else None


def _is_uncovered(seen: list[tuple[VisibilityCoverage, ObjectCoverage]]) -> bool:
    """Return whether combinations with an object in view never showed it, or too seldom.

    One combination that covers the object in enough frames suffices.
    """
    if not any(one.shown for _, one in seen):
        return any(coverage.is_due(one) for coverage, one in seen)
    due = [one for _, one in seen if one.in_view >= _SHARE_FRAMES]
    return bool(due) and not any(one.is_covered for one in due)
