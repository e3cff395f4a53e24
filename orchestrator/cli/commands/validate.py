"""`wil-campaign validate`: reports all faults of campaign, world, recipe and bench files."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, load_campaign
from wil_campaign.campaigns.setup.bench_file import Bench, load_benches, read_bench
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.foundation.files.document_writer import require_own_file, write_atomically
from wil_campaign.foundation.files.documents import BadInput, Problem
from wil_campaign.hooks import campaign_keys, problem_formats
from wil_campaign.installed_plugins import absent_additions, load_plugin_object, plugin_additions
from wil_campaign.orchestrator.cli.announcements import announce_problems
from wil_campaign.orchestrator.cli.clock_choice import campaign_clock_for, external_needs
from wil_campaign.orchestrator.cli.plugin_options import (
    NO_OPTIONS,
    PluginOptions,
    given_options,
    takes_options,
)
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.cli.text_table import count_text
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.language.recipe_files import load_recipe_document
from wil_campaign.worlds.world_file.world import World


@takes_options(problem_formats, "formats", Path | None)
def validate(
    *files: Path,
    clock: Clock | None = None,
    set_: Annotated[tuple[str, ...], Parameter(name="--set", negative=())] = (),
    bench_file: Annotated[tuple[Path, ...], Parameter(negative=())] = (),
    formats: PluginOptions = NO_OPTIONS,
) -> int:
    """Report all faults of files; nothing flies.

    Parameters
    ----------
    files
        Campaign files, with the world and recipe that each names; or world, recipe or bench files.
    clock
        Also check that campaigns can fly on this clock: virtual, wall or scaled.
    set_
        KEY=VALUE, as of `run`: campaigns are checked with this override.
    bench_file
        A bench, as of `run`, for campaigns that request one.
    """
    if not files:
        write_stderr("validate needs at least one file")
        return 2
    for name in given_options(formats):
        if why := absent_additions(problem_formats).get(name):
            write_stderr(why)
            return 2
    for name, path in given_options(formats).items():
        require_own_file(path, plugin_additions(problem_formats)[name].mark.encode())
    options = ExpansionOptions(
        sets=set_, is_autonomy_isolated=True, benches=load_benches(bench_file)
    )
    problems: list[Problem] = []
    warnings: list[Problem] = []
    for file in files:
        try:
            write_stdout(_check_file(file, clock, options, warnings))
        except BadInput as error:
            problems += error.problems
            warnings += error.warnings
            for warning in error.warnings:
                write_stderr(f"warning: {warning}")
    found = tuple(dict.fromkeys(problems))
    for problem in found:
        write_stderr(problem)
    warned = tuple(dict.fromkeys(warnings))
    announce_problems(found, warned)
    is_written = _write_formats(formats, found, warned)
    if not found:
        return 0 if is_written else 3
    names = len({problem.file for problem in found})
    write_stderr(f"{count_text(len(found), 'problem')} in {count_text(names, 'file')}")
    return 2


def _write_formats(
    formats: PluginOptions, problems: tuple[Problem, ...], warnings: tuple[Problem, ...]
) -> bool:
    """Write what was found in the formats that were asked for; return whether all are there."""
    is_written = True
    for name, path in given_options(formats).items():
        text = load_plugin_object(plugin_additions(problem_formats)[name].text)(problems, warnings)
        try:
            write_atomically(path, text)
        except OSError as error:
            write_stderr(f"{path}: cannot be written: {error.strerror or error}")
            is_written = False
    return is_written


def _check_file(
    file: Path, clock: Clock | None, options: ExpansionOptions, warnings: list[Problem]
) -> str:
    """Return a line about a valid file of any kind; add what it warns of. Raises BadInput."""
    document = load_recipe_document(file)
    schema = document.get(("schema",))
    if schema == "wil/world/1":
        world = World.parse(document)
        return f"{file}: a world of {count_text(len(world.objects), 'object')}"
    if schema == "wil/recipe/1":
        recipe = load_recipe(document)
        return f"{file}: a recipe of {count_text(len(recipe.combinations), 'combination')}"
    if schema == "wil/bench/1":
        return f"{file}: {bench_summary(read_bench(document))}"
    campaign = load_campaign(file, options)
    warnings += campaign.warnings
    for warning in campaign.warnings:
        write_stderr(f"warning: {warning}")
    for name, key in plugin_additions(campaign_keys).items():
        if campaign.document.get((name,)) is not None:
            load_plugin_object(key.check)(campaign)
    chosen = campaign_clock_for(campaign, clock)
    outside = ", ".join(dict.fromkeys(one.name for one in external_needs(campaign)))
    because = f"; {chosen} clock, for {outside}" if outside else ""
    return f"{file}: {_summary(campaign)}{because}"


def bench_summary(bench: Bench) -> str:
    """Return the summary of a valid bench."""
    return f"bench {bench.facts}, {bench.vehicle.autopilot} on {bench.vehicle.attached}"


def _summary(campaign: Campaign) -> str:
    required = sum(run.required for run in campaign.runs)
    sizes = (
        count_text(len(campaign.cases), "case"),
        count_text(len(campaign.modes), "mode"),
        count_text(campaign.repetitions, "repetition"),
    )
    runs = f"{count_text(len(campaign.runs), 'run')} ({' x '.join(sizes)})"
    controls = f", {count_text(len(campaign.controls), 'control')}" if campaign.controls else ""
    return f"campaign '{campaign.name}', {runs}, {required} required{controls}"
