"""Caveats of a campaign: what a reader of a PASS has to know; pure.

Overridden checks, messages that were not recorded, fences changed in flight, oracles that failed
without failing their run, and default oracles that were switched off.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from wil_campaign.orchestrator.run_results.attempts import attempt_text
from wil_campaign.orchestrator.run_results.campaign_results import Summary
from wil_campaign.orchestrator.run_results.result_parts import SourceResult
from wil_campaign.orchestrator.run_results.run_result import (
    CombinationResult,
    RunResult,
    SlowAutonomy,
)


def campaign_caveats(runs: Sequence[RunResult]) -> list[str]:
    """Return all caveats of a campaign as lines for people."""
    lines = _overridden_lines(runs)
    lines += [f"before arming: {text}" for text in sender_texts(runs)]
    lines += [f"fence changed in flight: {text}" for text in fence_texts(runs)]
    lines += [f"reported only, and failed: {text}" for text in reported_texts(runs)]
    lines += [f"not judged: {text}" for text in unjudged_texts(runs)]
    lines += [f"judged by dead reckoning: {text}" for text in dead_reckoning_texts(runs)]
    lines += [f"the twin dropped out: {text}" for text in dropped_out_texts(runs)]
    lines += [f"parameters or fence not restored: {text}" for text in unrestored_texts(runs)]
    lines += [f"missing in run.mcap: {text}" for text in loss_texts(runs)]
    lines += [f"virtual objects in the mixture not measured: {t}" for t in unmeasured_texts(runs)]
    lines += [f"simulator's images not compared with the world: {t}" for t in drawn_texts(runs)]
    lines += [f"registration error not bounded: {text}" for text in unbounded_texts(runs)]
    lines += [f"virtual object in view, and in no mixture: {text}" for text in unshown_texts(runs)]
    lines += [f"virtual object never in view: {text}" for text in unseen_texts(runs)]
    lines += [f"never moved while the goal was flown: {text}" for text in unmoved_texts(runs)]
    lines += [f"slower than real time: {text}" for text in slow_texts(runs)]
    lines += [f"live view ended early: {text}" for text in view_texts(runs)]
    return lines


def retried_texts(runs: Iterable[RunResult]) -> list[str]:
    """Return which runs took more than one attempt, how many, and how the earlier ones ended."""
    return [
        f"{run.case} {run.mode} #{run.rep}: {run.verdict} at attempt {len(run.attempts) + 1}, "
        f"after {'; '.join(map(attempt_text, run.attempts))}"
        for run in runs
        if run.attempts
    ]


def synthesised_texts(summary: Summary) -> list[str]:
    """Return the caveat of readings that the real vehicle did not measure, as lines for people."""
    names = _synthesised(summary)
    if not names:
        return []
    origin = "computed from the pose of the real vehicle and its world, not measured"
    return [f"synthesised readings: {', '.join(names)} ({origin})"]


def _synthesised(summary: Summary) -> list[str]:
    return [name for name, kind in summary.sensors.items() if kind == "synthesised"]


def unrestored_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return which attached vehicles kept the onboard configuration of which runs."""
    return _in_runs(
        (f"{name} kept those of its run, until the next start restores them", run)
        for run in runs
        for name in sorted({step.vehicle for step in run.before_arming if step.restored is False})
    )


def loss_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return the caveat of messages missing in recordings, by topic, and in which runs."""
    return _in_runs(
        (f"{loss.lost} of {loss.offered} of {loss.topic}", run)
        for run in runs
        for loss in run.losses
    )


def unmeasured_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return the caveat of passed runs with mixtures not checked for virtual objects, by sensor."""
    return _in_runs(
        (
            f"{result.name}{', in part' if result.frames_measured else ''}: {result.not_measured}",
            run,
        )
        for run, result in _passed_combinations(runs)
        if result.not_measured
    )


def drawn_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return the caveat of passed runs whose simulator images were not compared with the world.

    Where they were mixed in, the mixture was measured, or its own caveat says why not.
    """
    return _in_runs(
        (f"{source_result.vehicle} {source_result.sensor}: {source_result.not_measured}", run)
        for run, source_result in _uncompared_sources(runs)
    )


def _uncompared_sources(runs: Iterable[RunResult]) -> Iterator[tuple[RunResult, SourceResult]]:
    """Yield the simulators whose images in a passed run were not compared with the world."""
    for run in runs:
        if run.verdict == "PASS" and run.outside is not None and run.mixing is None:
            yield from ((run, source) for source in run.outside.sources if source.not_measured)


def unbounded_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return the caveat of passed runs whose registration error is unknown and unbounded."""
    return _in_runs(
        (f"{result.name}: {result.not_bounded}", run)
        for run, result in _passed_combinations(runs)
        if result.not_bounded
    )


def unshown_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return the caveat of virtual objects that were in view in a passed run, and never shown."""
    return _in_runs((name, run) for run in runs for name in _unshown(run))


def _unshown(run: RunResult) -> list[str]:
    """Return the virtual objects in view that no mixture of a passed run showed, sorted."""
    in_view: set[str] = set()
    shown: set[str] = set()
    for _, result in _passed_combinations((run,)):
        in_view.update(name for name, count in result.not_mixed.items() if count)
        in_view.update(name for name, each in result.shown.items() if each.frames_in_view)
        shown.update(name for name, each in result.shown.items() if each.frames_shown)
    return sorted(in_view - shown)


def unseen_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return the caveat of objects named by goal or oracles that no mixture had in view."""
    return _in_runs((name, run) for run in runs for name in _unseen(run))


def _unseen(run: RunResult) -> list[str]:
    """Return what the goal or an oracle of a passed run names, and no mixture had in view."""
    return [] if run.verdict != "PASS" or run.mixing is None else list(run.mixing.unseen)


def unmoved_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return the caveat of objects with a motion that stood still in passed runs."""
    return _in_runs((name, run) for run in runs for name in _unmoved(run))


def _unmoved(run: RunResult) -> tuple[str, ...]:
    """Return the objects with a motion that stood still in a passed run."""
    return run.unmoved if run.verdict == "PASS" else ()


def sender_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return the caveat of other senders with a vehicle's ids, as the preflight named them."""
    return _in_runs(
        (str(item), run) for run in runs for item in run.preflight if item.check == "sender"
    )


def dead_reckoning_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return the caveat of passed runs with a signal that has one: what was lost, and when."""
    return _in_runs(
        (f"{result.vehicle}: {result.caveat}", run)
        for run in runs
        if run.verdict == "PASS"
        for result in run.evidence
        if result.caveat
    )


def dropped_out_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return why twins dropped out, and in which runs, whatever their verdict."""
    return _in_runs(
        (run.twin.dropped_out.reason, run)
        for run in runs
        if run.twin is not None and run.twin.dropped_out is not None
    )


def _passed_combinations(
    runs: Iterable[RunResult],
) -> Iterator[tuple[RunResult, CombinationResult]]:
    for run in runs:
        if run.verdict == "PASS" and run.mixing is not None:
            yield from ((run, combination) for combination in run.mixing.combinations)


def slow_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return the caveat of autonomies slower than real time in passed runs: the slowest of each."""
    found = [
        (slow_autonomy, run) for run in runs if run.verdict == "PASS" for slow_autonomy in run.slow
    ]
    worst: dict[tuple[str, str, str], SlowAutonomy] = {}
    for slow_autonomy, run in sorted(
        found, key=lambda pair: pair[0].needed_s / max(pair[0].had_s, 1e-9)
    ):
        worst[slow_autonomy.vehicle, run.case, run.mode] = slow_autonomy
    return _in_runs(
        (_slow_text(worst[slow_autonomy.vehicle, run.case, run.mode]), run)
        for slow_autonomy, run in found
    )


def view_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return which live views ended early, and why; no verdict depends on them."""
    return _in_runs((text, run) for run in runs for text in run.views_ended)


def _slow_text(one: SlowAutonomy) -> str:
    return (
        f"the autonomy of {one.vehicle} needed {one.needed_s:.1f} s on this machine for its calls "
        f"and would have had {one.had_s:.1f} s: on the wall clock it fails"
    )


def caveats_in_short(summary: Summary) -> list[str]:
    """Return the caveats in a few words each, for the last line of a campaign.

    Failed oracles that are only reported are listed for an accepted campaign alone.
    """
    runs = summary.runs
    reported = _reported_lines(runs) if summary.accepted else ()
    names_by_text: dict[str, Iterable[str]] = {
        "synthesised readings: ": _synthesised(summary),
        "preflight overridden by ": (item.by for run in runs for item in run.preflight if item.by),
        "fence changed in flight by ": (
            fence_change.by for run in runs for fence_change in run.fence_changes
        ),
        "not judged: ": (name for run in runs for name in run.not_judged),
        "missing in part in run.mcap: ": (loss.topic for run in runs for loss in run.losses),
        "in view, and in no mixture: ": (name for run in runs for name in _unshown(run)),
        "never in view: ": (name for run in runs for name in _unseen(run)),
        "never moved: ": (name for run in runs for name in _unmoved(run)),
        "slower than real time: ": (
            slow_autonomy.vehicle
            for run in runs
            if run.verdict == "PASS"
            for slow_autonomy in run.slow
        ),
        "not compared with the world: ": (
            f"{source_result.vehicle} {source_result.sensor}"
            for _, source_result in _uncompared_sources(runs)
        ),
        "judged by dead reckoning: ": (
            result.vehicle
            for run in runs
            if run.verdict == "PASS"
            for result in run.evidence
            if result.caveat
        ),
        "other senders: ": (
            item.vehicle for run in runs for item in run.preflight if item.check == "sender"
        ),
        "the twin dropped out: ": (
            f"{run.case} {run.mode}"
            for run in runs
            if run.verdict == "PASS" and run.twin is not None and run.twin.dropped_out is not None
        ),
        "parameters or fence not restored: ": (
            step.vehicle for run in runs for step in run.before_arming if step.restored is False
        ),
        "mixture not measured: ": (
            result.name for _, result in _passed_combinations(runs) if result.not_measured
        ),
        "registration error not bounded: ": (
            result.name for _, result in _passed_combinations(runs) if result.not_bounded
        ),
        "reported only, and failed: ": (name for name, _ in reported),
    }
    texts = ((text, ", ".join(sorted(set(names)))) for text, names in names_by_text.items())
    return [text + names for text, names in texts if names]


def overridden_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return the caveat of overridden preflight checks, and by whom."""
    items = (item for run in runs for item in run.preflight if item.by)
    return sorted({f"{item.vehicle} {item.check} by {item.by}".strip() for item in items})


def fence_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return the caveat of fences changed in flight: which vehicles, by whom, which runs."""
    return _in_runs(
        (f"{' and '.join(change.vehicles)} by {change.by}", run)
        for run in runs
        for change in run.fence_changes
    )


def reported_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return the caveat of oracles that failed in passed runs, and in which."""
    return _in_runs(_reported_lines(runs))


def unjudged_texts(runs: Sequence[RunResult]) -> list[str]:
    """Return the caveat of switched-off oracles that always judge, and in which runs."""
    return _in_runs((name, run) for run in runs for name in run.not_judged)


def _reported_lines(runs: Iterable[RunResult]) -> list[tuple[str, RunResult]]:
    """Return the oracles of the judged vehicle that failed in a passed run."""
    return [
        (oracle.name, run)
        for run in runs
        if run.verdict == "PASS"
        for oracle in run.oracles
        if oracle.verdict != "PASS" and not oracle.required and oracle.vehicle == run.subject
    ]


def _overridden_lines(runs: Sequence[RunResult]) -> list[str]:
    """Return caveats of overridden preflight checks: in how many runs, and the first result."""
    first: dict[tuple[str, str, str], str] = {}
    counted: Counter[tuple[str, str, str]] = Counter()
    for run in runs:
        for item in run.preflight:
            if item.outcome == "overridden":
                key = (item.vehicle, item.check, item.by)
                first.setdefault(key, str(item))
                counted[key] += 1
    return [f"preflight, {counted[key]} of {len(runs)} runs: {text}" for key, text in first.items()]


def _in_runs(found: Iterable[tuple[str, RunResult]]) -> list[str]:
    """Return each caveat once, with its cases and modes, and in how many runs."""
    where: dict[str, dict[str, set[int]]] = {}
    for text, run in found:
        where.setdefault(text, {}).setdefault(f"{run.case} {run.mode}", set()).add(run.rep)
    return [
        f"{text} ({'; '.join(f'{place}, {_count(reps)}' for place, reps in places.items())})"
        for text, places in where.items()
    ]


def _count(repetitions: set[int]) -> str:
    count = len(repetitions)
    return f"{count} run{'' if count == 1 else 's'}"
