"""MQTT reports: topics beneath <root>/<campaign>, with JSON objects as payload; pure."""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.orchestrator.operator.run_messages import (
    News,
    RunEventReport,
    RunProgressReport,
    VehicleProgress,
)
from wil_campaign.orchestrator.run_results.run_result import RunResult

_LONGEST_STATUS_BYTES = 1 << 20
_LONGEST_SESSION = 64


@dataclass(frozen=True, slots=True)
class Publication:
    """An MQTT message to publish. important: queued while disconnected, sent at least once."""

    topic: str
    payload: bytes
    important: bool = False
    retain: bool = False


def publications_of_news(news: News) -> Iterator[Publication]:
    """Yield the MQTT messages that report a run's news."""
    if isinstance(news, RunProgressReport):
        yield _publication("run", {"run": news.run, **_progress_fields(news)})
        for vehicle in news.vehicles:
            yield _publication(
                f"vehicle/{vehicle.name}", {"run": news.run, **_vehicle_fields(vehicle)}
            )
        return
    common = {"run": news.run, "t_s": round(news.t_s, 6)}
    match news.kind:
        case "stage":
            yield _publication("run", {**common, "stage": news.word}, important=True)
        case "collision":
            collision = {"oracle": news.word, "vehicle": news.vehicle, "text": news.text}
            yield _publication("collision", {**common, **collision}, important=True)
        case "decisive":
            verdict = {"verdict": news.word, "reason": news.text, "final": False}
            yield _publication("verdict", {**common, **verdict}, important=True)
        case "guard":
            yield _guard_report(common, news)
        case "answer":
            yield acknowledgement_publication(
                id=news.command_id,
                command="geofence",
                ok=news.word == "ok",
                text=news.text,
                who=news.who,
                run=news.run,
                final=True,
            )


def verdict_publication(result: RunResult) -> Publication:
    """Return the MQTT report of a run's final verdict."""
    return _publication(
        "verdict",
        {
            "run": f"{result.case}/{result.mode}/{result.rep}",
            "verdict": result.verdict,
            "reason": result.reason,
            "required": result.required,
            "final": True,
        },
        important=True,
    )


def session_in_flight(payload: bytes) -> str:
    """Return the session of a status, for a message; empty where none is in flight by it."""
    try:
        status = json.loads(payload[:_LONGEST_STATUS_BYTES])
    except (ValueError, RecursionError):
        return ""
    if not isinstance(status, dict) or status.get("state") not in ("flying", "held", "landing"):
        return ""
    return printable_problem(str(status.get("session", ""))[:_LONGEST_SESSION])


def status_publication(status: dict[str, Any]) -> Publication:
    """Return the MQTT report of the campaign's status, retained for later subscribers."""
    return _publication("status", status, important=True, retain=True)


def acknowledgement_publication(**fields: str | bool) -> Publication:
    """Return the MQTT reply to a command."""
    return _publication("operator/ack", fields, important=True)


def _guard_report(common: dict[str, Any], news: RunEventReport) -> Publication:
    body = {**common, "event": news.word, "vehicle": news.vehicle, "text": news.text}
    return _publication("guard", body, important=True)


def _progress_fields(news: RunProgressReport) -> dict[str, Any]:
    return {
        "t_s": round(news.t_s, 3),
        "stage": news.stage,
        "clearance_m": _round_value(news.clearance_m),
        "mixing_rate_hz": _round_value(news.mixing_rate_hz),
        "skew_ms": _round_value(news.skew_ms),
        "verdict_so_far": news.verdict_so_far,
    }


def _vehicle_fields(vehicle: VehicleProgress) -> dict[str, Any]:
    place, speed = vehicle.position_ned_m, vehicle.velocity_ned_m_s
    return {
        "armed": vehicle.armed,
        "mode": vehicle.mode,
        "landed": vehicle.landed,
        "position_ned_m": None if place is None else [_round_value(value) for value in place],
        "velocity_ned_m_s": None if speed is None else [_round_value(value) for value in speed],
        "battery_fraction": _round_value(vehicle.battery_fraction),
    }


def _round_value(value: float | None) -> float | None:
    """Return a value rounded for an MQTT report; None when not finite."""
    return round(value, 3) if value is not None and math.isfinite(value) else None


def _publication(
    topic: str, body: dict[str, Any], *, important: bool = False, retain: bool = False
) -> Publication:
    """Return an MQTT message of a topic with a JSON body."""
    payload = json.dumps(body, ensure_ascii=False, allow_nan=False).encode()
    return Publication(topic, payload, important, retain)
