"""Loads campaign files for Python programs, validates them, judges and reports recorded runs."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, load_campaign
from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.bench_file import load_benches
from wil_campaign.foundation.files.documents import BadInput, Problem
from wil_campaign.orchestrator.campaign.reevaluation import Judgement, judge_campaign_again
from wil_campaign.orchestrator.cli.run_selection import RunSelection
from wil_campaign.orchestrator.report.ordered_report import Report, write_ordered_report
from wil_campaign.plugins.python.several import as_several


def load(
    file: str | Path,
    *,
    cases: Sequence[str] = (),
    modes: Sequence[Mode] = (),
    repetitions: int | None = None,
    seed: int | None = None,
    overrides: Mapping[str, object] | None = None,
    bench_files: Sequence[str | Path] = (),
) -> Campaign:
    """Return a campaign file with its runs, checked as `wil-campaign validate` does.

    cases: globs; modes: of sim, wil, real; empty for all. repetitions, seed: None for those of the
    file. overrides: by dotted key of the campaign, or of world.* or recipe.*, as of --set.
    bench_files: benches of this machine, for a campaign that requests one. Raises BadInput with
    every problem of the file and of those that it names.
    """
    choice = RunSelection(
        case=as_several(cases),
        mode=as_several(modes),
        repetitions=repetitions,
        seed=seed,
        set_=set_option_texts(overrides),
        bench_file=tuple(map(Path, as_several(bench_files))),
    )
    return load_campaign(Path(file), choice.options())


def validate(
    file: str | Path,
    *,
    overrides: Mapping[str, object] | None = None,
    bench_files: Sequence[str | Path] = (),
) -> tuple[Problem, ...]:
    """Return every problem of a campaign file and of those that it names; none when it is valid.

    Nothing flies. overrides, bench_files: as of `load`.
    """
    try:
        load(file, overrides=overrides, bench_files=bench_files)
    except BadInput as error:
        return tuple(error.problems)
    return ()


def judge(
    file: str | Path,
    folder: str | Path,
    *,
    cases: Sequence[str] = (),
    modes: Sequence[Mode] = (),
    repetitions: int | None = None,
    overrides: Mapping[str, object] | None = None,
    bench_files: Sequence[str | Path] = (),
) -> Judgement:
    """Judge the recorded runs of a results folder by the oracles that the campaign file has now.

    Nothing flies, and nothing in the folder changes; neither the autonomy nor a step of the recipe
    is loaded. cases to bench_files: as of `load`, and those of the flight. Raises BadInput, and
    RecordingError where the recordings cannot be judged by this file.
    """
    selection = ExpansionOptions(
        cases=as_several(cases),
        modes=as_several(modes),
        repetitions=repetitions,
        sets=set_option_texts(overrides),
        loads_code=False,
        benches=load_benches(tuple(map(Path, as_several(bench_files)))),
    )
    return judge_campaign_again(load_campaign(Path(file), selection), Path(folder))


def set_option_texts(overrides: Mapping[str, object] | None) -> tuple[str, ...]:
    """Return overrides as of --set."""
    return tuple(f"{key}={json.dumps(value)}" for key, value in (overrides or {}).items())


def report(
    folder: str | Path,
    *,
    out: str | Path | None = None,
    videos: Sequence[str] = (),
    card: bool = False,
    gif: bool = False,
    run: str = "",
    workers: int | None = 1,
) -> Report:
    """Write the report of a campaign's results folder: one HTML page that needs no other file.

    out: the file; None: report.html in the folder. videos: runs whose mixed.mp4 is made of their
    recorded images first, as "large/wil/1", or "all". card, gif: write card.png and flight.gif into
    the folder of `run`; "" for the one to show first. workers: processes that read the runs; None:
    one per core, for which the main module must be importable.

    Raises ResultsFolderError for a folder without a campaign or an unknown run; OSError.
    """
    wanted = [name for name, is_wanted in (("card", card), ("gif", gif)) if is_wanted]
    return write_ordered_report(
        folder, out=out, videos=as_several(videos), pictures=wanted, run=run, workers=workers
    )
