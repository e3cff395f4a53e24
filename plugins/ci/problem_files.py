"""Faults of files as documents that CI systems read: SARIF 2.1.0, code quality of GitLab."""

import hashlib
import json
from collections import Counter
from typing import Any
from urllib.parse import quote

from wil_campaign.foundation.files.problems import Problem
from wil_campaign.orchestrator.installation import program_version
from wil_campaign.plugins.ci.repository_paths import repository_path

_RULE = "bad-input"
_SUMMARY = "A campaign, world, recipe or bench file that cannot be used as it is."


def sarif_text(problems: tuple[Problem, ...], warnings: tuple[Problem, ...]) -> str:
    """Return the faults and warnings as a SARIF log of one run of this program."""
    rule = {"id": _RULE, "shortDescription": {"text": _SUMMARY}}
    driver = {"name": "wil-campaign", "version": program_version(), "rules": [rule]}
    results = [_result(problem, "error") for problem in problems]
    results += [_result(warning, "warning") for warning in warnings]
    run = {"tool": {"driver": driver}, "columnKind": "unicodeCodePoints", "results": results}
    return json.dumps({"version": "2.1.0", "runs": [run]}, indent=2) + "\n"


def code_quality_text(problems: tuple[Problem, ...], warnings: tuple[Problem, ...]) -> str:
    """Return the faults and warnings as a report of GitLab's code quality.

    A fault that moved to another line is the same one.
    """
    seen: Counter[tuple[str, str]] = Counter()
    issues = []
    graded = [*((one, "major") for one in problems), *((warning, "minor") for warning in warnings)]
    for problem, severity in graded:
        seen[problem.file, problem.message] += 1
        number = seen[problem.file, problem.message]
        mark = f"{repository_path(problem.file)}\n{problem.message}\n{number}"
        issues.append(
            {
                "description": problem.text,
                "check_name": _RULE,
                "fingerprint": hashlib.sha256(mark.encode()).hexdigest(),
                "severity": severity,
                "location": {
                    "path": repository_path(problem.file) or problem.file,
                    "lines": {"begin": max(1, problem.line)},
                },
            }
        )
    return json.dumps(issues, indent=2) + "\n"


def _result(problem: Problem, level: str) -> dict[str, Any]:
    """Return a fault as a result of SARIF; an option of the command line has no location."""
    result: dict[str, Any] = {
        "ruleId": _RULE,
        "level": level,
        "message": {"text": problem.headline if problem.line == 0 else problem.text},
    }
    path = repository_path(problem.file)
    if path is not None:
        place: dict[str, Any] = {"artifactLocation": {"uri": quote(path)}}
        if problem.line:
            place["region"] = {"startLine": problem.line, "startColumn": problem.column}
        result["locations"] = [{"physicalLocation": place}]
    return result
