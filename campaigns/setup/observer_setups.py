"""The setups of what observes the runs of a case: each plugin reads its own key."""

from wil_campaign.campaigns.schema import CampaignPart
from wil_campaign.campaigns.setup.case_setup import ObserverSetup
from wil_campaign.foundation.files.documents import Document, Problem
from wil_campaign.hooks import run_observers
from wil_campaign.installed_plugins import added, load


def observer_setups(
    campaign: Document, part: CampaignPart, problems: list[Problem]
) -> dict[str, ObserverSetup]:
    """Return the observers' setups of a case by their keys; problems are collected."""
    found: dict[str, ObserverSetup] = {}
    for name, observer in added(run_observers).items():
        setup = load(observer.setup)(getattr(part, name), campaign, part, problems)
        if setup is not None:
            found[name] = setup
    return found
