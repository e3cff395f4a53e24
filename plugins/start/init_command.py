"""`wil-campaign init`: writes a campaign that is ready to fly, as a starting point."""

import re
import shlex
from importlib.resources import files
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from wil_campaign.foundation.files.document_writer import write_atomically
from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.foundation.files.yaml_nodes import yaml_of_word
from wil_campaign.hooks import starter_options, starters
from wil_campaign.installed_plugins import absent_additions, load_plugin_object, plugin_additions
from wil_campaign.orchestrator.cli.plugin_options import (
    NO_OPTIONS,
    PluginOptions,
    given_options,
    takes_options,
)
from wil_campaign.orchestrator.cli.standard_streams import write_stderr, write_stdout
from wil_campaign.orchestrator.installation import pip_requirement, program_text
from wil_campaign.plugins.start.schema_command import schema_texts

_WORKFLOW = ".github/workflows/wil-campaign.yml"
_FILES = {
    "campaign.yaml.in": "campaign.yaml",
    "world.yaml.in": "world.yaml",
    "recipe.yaml.in": "recipe.yaml",
    "autonomy.py.in": "autonomy.py",
    "github-workflow.yml.in": _WORKFLOW,
}
_PROFILE = "profile.yaml"
_BODY = "    body: {width_m: 0.3, height_m: 0.1}  # propellers included, feet to top"
"""A vehicle's body in a campaign with a profile of its own; the values are the default's."""
_PROFILE_KEY = re.compile(r"^( +profile: )\w+$", re.MULTILINE)
_SCHEMAS = "schemas"
"""The folder of the JSON Schemas that the first lines of the files name, for editors."""
_INSTALL = "      - run: pip install {requirement}"
_INSTALL_BY_HAND = """\
      # The wil-campaign that wrote this file, {program},
      # came from a folder or file of one machine, where no runner finds it. WIL_CAMPAIGN is what
      # pip installs: a repository and commit (wil-campaign @ git+https://...@COMMIT), the URL of a
      # wheel, or a wheel of this repository (./wheels/....whl).
      - env: {{WIL_CAMPAIGN: ""}}
        run: pip install "${{WIL_CAMPAIGN:?is empty; say in this workflow what pip installs}}"\
"""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


_LOG = "log"
"""The starter for --from."""


@takes_options(starter_options, "kinds", bool)
def init(
    name: str,
    *,
    folder: Annotated[Path | None, Parameter(name="--in")] = None,
    from_: Annotated[Path | None, Parameter(name="--from")] = None,
    profile: Annotated[bool, Parameter(negative=())] = False,
    kinds: PluginOptions = NO_OPTIONS,
) -> int:
    """Write a campaign that is ready to fly: campaign, world, recipe, autonomy, CI workflow.

    JSON Schemas are written beside them, with which editors complete and explain the files.

    No file is overwritten. Exit code 2: the name is not valid for a folder, a file exists already,
    or the log cannot be used; 3: the files cannot be written.

    Parameters
    ----------
    name
        The campaign's name.
    folder
        Where the files go; by default a new folder of that name.
    from_
        The log of a flight, whose course, origin, vehicle and parameters the campaign takes: a
        .tlog, .ulg (PX4) or .bin (ArduPilot), a bag of ROS 2 in MCAP, or the folder of a run.
    profile
        Write the vehicle's profile, too: every key with its unit and default, for your own drone;
        with --from as far as the log states it.
    """
    if fault := _fault_of(name, from_, kinds):
        write_stderr(fault)
        return 2
    place = Path(name) if folder is None else folder
    if from_ is None:
        texts = _template(name, kinds, profile=profile)
    else:
        texts = _from_log(from_, name, profile=profile)
    texts |= {f"{_SCHEMAS}/{file}": text for file, text in schema_texts().items()}
    if there := [one for one in texts if (place / one).exists()]:
        write_stderr(
            printable_problem(f"{place} has {', '.join(there)} already; nothing was written")
        )
        return 2
    try:
        for target, text in texts.items():
            path = place / target
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, text)
    except OSError as error:
        write_stderr(printable_problem(f"{place} cannot be written: {error.strerror or error}"))
        return 3
    for target in texts:
        write_stdout(printable_problem(str(place / target)))
    write_stdout("")
    if from_ is None and pip_requirement() is None:
        text = (
            f"before a first run on GitHub, set WIL_CAMPAIGN in {place / _WORKFLOW} to what pip is "
        )
        write_stdout(
            printable_problem(text + "to install there; flights on this machine do not need it")
        )
    write_stdout(printable_problem(f"next: wil-campaign run {place / 'campaign.yaml'}"))
    return 0


def _fault_of(name: str, log: Path | None, kinds: PluginOptions) -> str:
    """Return why nothing can be written as it is asked for; "" where it can."""
    for kind in given_options(kinds):
        if why := absent_additions(starter_options).get(kind):
            return why
        if log is not None:
            return f"--from {log} and --{kind}: one start at a time"
    if log is not None and (why := absent_additions(starters).get(_LOG)):
        return f"--from: {why}"
    if _NAME.fullmatch(name):
        return ""
    return printable_problem(
        f"'{name}' becomes a folder: use up to 64 of A-Z a-z 0-9 . _ - and begin "
    ) + ("with one of the letters or digits")


def _template(name: str, kinds: PluginOptions, *, profile: bool) -> dict[str, str]:
    """Return the texts of the template's files, by name."""
    texts = {target: _filled(source, name) for source, target in _FILES.items()}
    if profile:
        texts[_PROFILE] = _filled("profile.yaml.in", name)
        campaign = texts["campaign.yaml"]
        texts["campaign.yaml"] = _PROFILE_KEY.sub(rf"\g<1>{_PROFILE}\n{_BODY}", campaign)
    for kind in given_options(kinds):
        texts = load_plugin_object(plugin_additions(starter_options)[kind].files)(texts)
    return texts


def _from_log(log: Path, name: str, *, profile: bool) -> dict[str, str]:
    """Return the texts of a campaign's files from a log."""
    texts: dict[str, str] = load_plugin_object(plugin_additions(starters)[_LOG].files)(
        log, name, profile=profile
    )
    return texts


def _filled(source: str, name: str) -> str:
    """Return a starter file with the campaign's name."""
    text = (files("wil_campaign.plugins.start") / "starter" / source).read_text("utf-8")
    return text.replace("@NAME@", yaml_of_word(name)).replace("@INSTALL@", _install_step())


def _install_step() -> str:
    """Return the step of the workflow that installs the program from where this one came."""
    requirement = pip_requirement()
    if requirement is None:
        return _INSTALL_BY_HAND.format(program=program_text())
    return _INSTALL.format(requirement=shlex.quote(requirement))
