"""Loads campaign files for Python programs, and validates them."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from wil_campaign.campaigns.expansion.expansion import Campaign, load_campaign
from wil_campaign.campaigns.schema import Mode
from wil_campaign.orchestrator.cli.run_selection import Choice
from wil_campaign.worlds.files.documents import BadInput, Problem


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
    choice = Choice(
        case=tuple(cases),
        mode=tuple(modes),
        repetitions=repetitions,
        seed=seed,
        set_=tuple(f"{key}={json.dumps(value)}" for key, value in (overrides or {}).items()),
        bench_file=tuple(map(Path, bench_files)),
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
