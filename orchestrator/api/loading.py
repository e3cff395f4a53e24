"""Loads campaign files for Python programs, and validates them."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from campaigns.expansion.expansion import Campaign, Options, load_campaign
from campaigns.schema import Mode
from campaigns.setup.bench_file import load_benches
from worlds.files.documents import BadInput, Problem


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
    options = Options(
        cases=tuple(cases),
        modes=tuple(modes),
        repetitions=repetitions,
        seed=seed,
        sets=tuple(f"{key}={json.dumps(value)}" for key, value in (overrides or {}).items()),
        is_autonomy_isolated=True,
        benches=load_benches(map(Path, bench_files)),
    )
    return load_campaign(Path(file), options)


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
