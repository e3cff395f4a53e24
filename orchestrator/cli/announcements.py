"""Tells the announcers of plugins how a command ended; one that fails changes nothing."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.foundation.files.problems import BadInput, Problem
from wil_campaign.hooks import Announcer, announcers
from wil_campaign.installed_plugins import load_plugin_object, plugin_additions
from wil_campaign.orchestrator.cli.standard_streams import write_stderr
from wil_campaign.orchestrator.run_results.campaign_results import Summary


def announce_problems(problems: tuple[Problem, ...], warnings: tuple[Problem, ...]) -> None:
    """Announce problems of files, for which they are refused, and warnings about them."""
    _announce(lambda one: one.problems, problems, warnings)


def announce_verdicts(
    campaign: Campaign, summary: Summary, folder: Path, *, arm: bool = True
) -> None:
    """Announce how a campaign ended. folder: its results. arm: False for --no-arm."""
    _announce(lambda one: one.verdicts, campaign, summary, folder, arm=arm)


def _announce(function_of: Callable[[Announcer], str], *args: object, **options: Any) -> None:
    try:
        found = plugin_additions(announcers)
    except BadInput:
        return  # a plugin that cannot be used is the fault that is reported already
    for name, announcer in found.items():
        try:
            load_plugin_object(function_of(announcer))(*args, **options)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - the results are whole
            write_stderr(f"{name} announces nothing: {type(error).__name__}: {error}")
