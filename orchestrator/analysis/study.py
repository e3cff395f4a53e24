"""The statistics of a campaign: pass rates, tests between modes, agreement, the gap."""

from dataclasses import asdict, dataclass, field
from pathlib import Path

from orchestrator.analysis.gap.campaign_gap import read_gap
from orchestrator.analysis.gap.gap import Gap
from orchestrator.analysis.model import CampaignDocuments
from orchestrator.analysis.pass_rates import PassRates, pass_rates
from orchestrator.analysis.published import Published, published_of
from orchestrator.model.document_writer import to_json

SCHEMA = "wil/statistics/1"
FILE_NAME = "statistics.json"


@dataclass(frozen=True, slots=True)
class Study:
    """The statistics of one campaign. published: counts of another source, shown beside."""

    rates: PassRates
    gap: Gap
    published: Published = field(default_factory=Published)


def read_study(folder: Path, campaign: CampaignDocuments) -> Study:
    """Return the statistics of a results folder."""
    runs = [entry.result for entry in campaign.entries if entry.result is not None]
    published = published_of(campaign.manifest.get("document"))
    return Study(pass_rates(runs), read_gap(folder, campaign.entries), published)


def study_json(campaign: CampaignDocuments, study: Study) -> str:
    """Return the statistics of a campaign as the text of statistics.json."""
    return to_json(
        {
            "schema": SCHEMA,
            "campaign": campaign.name,
            "folder": campaign.folder,
            "pass_rates": [asdict(one) for one in study.rates.rates],
            "tests": [asdict(one) for one in study.rates.tests],
            "agreement": [asdict(one) for one in study.rates.agreement],
            "gap": [asdict(one) for one in study.gap.figures],
            "gap_energy": [asdict(one) for one in study.gap.energies],
            "flights": dict(study.gap.flights or {}),
            "left_out": list(study.gap.left_out),
            "published": {
                "source": study.published.source,
                "passed": [
                    {"case": case, "mode": mode, "passed": text}
                    for (case, mode), text in study.published.passed.items()
                ],
            },
        }
    )
