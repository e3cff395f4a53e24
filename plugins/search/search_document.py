"""The document of a search, search.json: its variants, failures, coverage and cost."""

from collections.abc import Mapping
from typing import Any

from wil_campaign.plugins.search.exploration.coverage import space_coverage_of
from wil_campaign.plugins.search.exploration.model import FailingCase, SearchFindings, TriedVariant
from wil_campaign.plugins.search.exploration.search_campaign import SearchCampaign
from wil_campaign.plugins.search.exploration.sensed import EDGES_M, SensedCoverage, sensed_coverage

FILE_NAME = "search.json"
BROKEN = (
    "an internal exception came up beside the flights (log.jsonl in a folder of flights/ has it): "
    "the search ends with exit code 3"
)


def search_document(
    search: SearchCampaign,
    findings: SearchFindings,
    *,
    ended: str,
    files: Mapping[str, str],
    at_once: int,
    is_broken: bool,
) -> dict[str, Any]:
    """Return the document of a search. ended: why it ended. files: of confirmed failures, by name.

    is_broken: there was an internal error beside its flights.
    Only `wall_s` depends on the machine.
    """
    part = search.part
    return {
        "campaign": search.campaign.name,
        "case": search.case,
        "seed": search.campaign.seed,
        "strategy": part.strategy,
        "at_once": at_once,
        "objective": list(part.oracles),
        "budget": part.flights_by_mode,
        "seeds": part.seeds,
        "parameters": [
            {
                "name": parameter.name,
                "keys": list(parameter.keys),
                "unit": parameter.unit,
                "from": parameter.low if parameter.is_number else None,
                "to": parameter.high if parameter.is_number else None,
                "integer": parameter.is_integer,
                "choices": list(parameter.choices),
                "own": parameter.own,
            }
            for parameter in search.space.parameters
        ],
        "constraints": [constraint.text for constraint in search.space.constraints],
        "ended": ended,
        "broken": is_broken,
        "failures": [
            _failure_entry(search, failing_case, files) for failing_case in findings.cases
        ],
        "gaps": [
            {
                "from": gap.lower,
                "to": gap.upper,
                "pairs": len(gap.differences),
                "mean": gap.mean,
                "spread": gap.spread,
            }
            for gap in findings.gaps
        ],
        "costs": [
            {
                "mode": mode,
                "purpose": purpose,
                "flights": cost.flights,
                "flight_s": round(cost.flight_s, 3),
                "wall_s": round(cost.wall_s, 3),
            }
            for (mode, purpose), cost in findings.costs.items()
        ],
        "coverage": _coverage_entry(search, findings),
        "sensed": [_sensed_entry(coverage) for coverage in sensed_coverage_of(findings)],
        "variants": [_variant_entry(tried_variant) for tried_variant in findings.tried],
        "refused": [
            {"name": variant.name, "values": dict(variant.values), "reason": why}
            for variant, why in findings.refused
        ],
    }


def sensed_coverage_of(findings: SearchFindings) -> tuple[SensedCoverage, ...]:
    """Return what the sensors had in view in all flights with PASS or FAIL."""
    proven = (
        flight_outcome
        for flight_outcome in findings.flown
        if flight_outcome.verdict in {"PASS", "FAIL"}
    )
    return sensed_coverage(
        (flight_outcome.sensed, flight_outcome.verdict == "FAIL") for flight_outcome in proven
    )


def unsettled_texts(findings: SearchFindings) -> list[str]:
    """Return in words what of a search is unsettled: open failures, variants without a result.

    Also at which rate what is not confirmed may still fail.
    """
    texts = [text for failing_case in findings.cases if (text := _rate_text(failing_case))]
    if findings.open_failures and not findings.confirmed:
        count = len(findings.open_failures)
        are = "failure is" if count == 1 else "failures are"
        texts.append(f"{count} {are} neither confirmed nor refuted")
    for gap in findings.gaps:
        if doubtful := len(findings.doubtful(gap)):
            word, were = ("variant", "was") if doubtful == 1 else ("variants", "were")
            few = len(gap.differences)
            by = "by the gap" if gap.is_measured else f"as {few} pairs do not measure the gap"
            texts.append(
                f"{doubtful} {word} may fail in {gap.upper} {by}, and {were} not flown there: the "
                "budget is used up"
            )
    for mode in findings.modes:
        if unproven := len(findings.unproven_in(mode)):
            count = len(findings.flown_in(mode))
            where = "" if mode == findings.modes[0] else f" in {mode}"
            texts.append(f"{unproven} of {count} variants proved nothing{where} (no PASS, no FAIL)")
    return texts


def _rate_text(case: FailingCase) -> str:
    """Return at which rate a failure that is not confirmed comes back; "" for others."""
    if case.interval is None or case.standing in {"confirmed", "undecided"}:
        return ""
    low, high = case.interval.low, case.interval.high
    flights = f"{case.proven} flight{'s' if case.proven != 1 else ''}"
    if case.standing == "intermittent":
        return (
            f"{case.variant.name} failed again in {case.failed} of {flights}, too seldom to be "
            f"confirmed and not refuted: it fails at a rate of {low:.2f} to {high:.2f}"
        )
    return (
        f"{case.variant.name} failed, and not again in {flights}: "
        f"a rate of up to {high:.2f} is not excluded"
    )


def _sensed_entry(one: SensedCoverage) -> dict[str, Any]:
    return {
        "sensor": one.sensor,
        "object": one.object,
        "flights": one.flights,
        "seen_in": one.seen,
        "nearest_m": one.nearest_m,
        "largest_share": one.largest_share if one.object else None,
        "distinct_readings": one.reduced,
        "last_new_in_flight": one.newest,
        "sectors": one.sectors,
        "edges_m": list(EDGES_M),
        "cells": [
            {"sector": sector, "level": level, "flights": count, "failed": failed}
            for (sector, level), count in one.cells.items()
            for failed in (one.failed.get((sector, level), 0),)
        ],
        "of_cells": one.of_cells,
    }


def _variant_entry(tried: TriedVariant) -> dict[str, Any]:
    return {
        "name": tried.variant.name,
        "values": dict(tried.variant.values),
        "modes": {
            mode: {
                "value": tried.value(mode),
                "verdicts": [outcome.verdict for outcome in outcomes],
                "causes": [outcome.cause for outcome in outcomes],
                "reasons": [outcome.reason for outcome in outcomes],
            }
            for mode, outcomes in tried.outcomes.items()
        },
    }


def _failure_entry(
    search: SearchCampaign, case: FailingCase, files: Mapping[str, str]
) -> dict[str, Any]:
    interval = case.interval
    return {
        "name": case.variant.name,
        "mode": case.mode,
        "standing": case.standing,
        "cause": case.cause,
        "causes": dict(case.causes),
        "failed": case.failed,
        "proven": case.proven,
        "interval": None
        if interval is None
        else {"low": interval.low, "high": interval.high, "confidence": interval.confidence},
        "values": dict(case.variant.values),
        "reduced": {
            "values": dict(case.reduced.values),
            "keys": search.overrides(case.reduced.values),
            "failed": case.reduced_failed,
            "proven": case.reduced_proven,
            "causes": dict(case.reduced_causes),
            "is_smallest": case.is_reduced,
        },
        "file": files.get(case.variant.name),
    }


def _coverage_entry(search: SearchCampaign, findings: SearchFindings) -> dict[str, Any]:
    """Return the entry of how much of the space has flights that proved something."""
    coverage = space_coverage_of(search.space, findings.proven_values)
    return {
        "cells": coverage.cells,
        "flown": coverage.flown,
        "share": coverage.share,
        "farthest": coverage.farthest,
        "distance": coverage.distance,
    }
