"""`wil-campaign replay`: mix a recorded run again, and report where the result diverges."""

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.plugins.offline.calls import replay
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.plugins.offline.replay import ReplayedCombination, ReplayReport
from wil_campaign.recipes.working import StepError

_SHOWN = 5


def replay_run(
    run: Path,
    *,
    recipe: Path | None = None,
    trust: Annotated[bool, Parameter(negative=())] = False,
    out_: Annotated[Path | None, Parameter(name="--out")] = None,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Mix a recorded run again, and report where the result diverges from the recording.

    Exits with 0 when it does not diverge, with 1 when it does, and with 3 when the recording is cut
    or lacks messages, or has no mixture to compare.

    Parameters
    ----------
    run
        A run's folder, or its run.mcap.
    recipe
        Another recipe; by default that of the run.
    trust
        Run the user's own steps that the recording names; without it a recording that names code
        is refused. Steps of a --recipe run in any case.
    out_
        A folder for the mixture as a video, and for the worst divergence as an image: the recorded
        image, the new one, and their difference.
    json_
        Print one JSON document.
    """
    try:
        report = replay(run, recipe=recipe, trust=trust, out=out_)
    except OfflineError as error:
        write_stderr(error)
        return 2
    except (StepError, OSError) as error:
        write_stderr(error)
        return 3
    write_stdout(_as_json(report) if json_ else _as_text(report))
    if out_ is not None and not json_:
        write_stdout(f"written: {out_}")
    if report.diverges:
        return 1
    return 0 if report.compared and not report.lacks else 3


def _as_text(report: ReplayReport) -> str:
    """Return the replay's report as text."""
    lines = [line for combination in report.combinations for line in _lines(combination)]
    lines += [f"{name}: recorded, but not made by the recipe" for name in report.without]
    if report.lacks:
        lines.append(report.lacks)
    return "\n".join(lines)


def _lines(one: ReplayedCombination) -> list[str]:
    """Return the report lines of one replayed combination."""
    how = "to the bit" if one.exact else "within the loss of JPEG"
    left_out = ", ".join(f"{what} {count}" for what, count in one.dropped.items())
    mixed = f"{one.name}: {one.mixed} of {one.frames} mixed"
    mixed += f" ({left_out})" if left_out else ""
    if not one.compared:
        return [f"{mixed}; the recording has no mixture to compare"]
    if not one.divergences:
        return [f"{mixed}; all as recorded, {how}"]
    lines = [f"{mixed}; {len(one.divergences)} of {one.compared} differ from the recording"]
    for found in one.divergences[:_SHOWN]:
        at = "" if found.t_s is None else f" at {found.t_s:.3f} s"
        lines.append(f"  frame {found.frame}{at}: {found.difference.what}")
    if len(one.divergences) > _SHOWN:
        lines.append(f"  and {len(one.divergences) - _SHOWN} more")
    return lines


def _as_json(report: ReplayReport) -> str:
    """Return the replay's report as JSON."""
    document = {
        "diverges": report.diverges,
        "lacks": report.lacks,
        "without": list(report.without),
        "combinations": [
            {
                "name": combination.name,
                "frames": combination.frames,
                "mixed": combination.mixed,
                "dropped": dict(combination.dropped),
                "compared": combination.compared,
                "exact": combination.exact,
                "divergences": [
                    {"frame": found.frame, "t_s": found.t_s, "what": found.difference.what}
                    for found in combination.divergences
                ],
            }
            for combination in report.combinations
        ],
    }
    return json.dumps(document, indent=2, ensure_ascii=False)
