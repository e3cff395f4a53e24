"""The statistics of a campaign: pass rates, tests between modes, agreement, the gap."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Self

from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.reading.model import CampaignDocuments
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.plugins.statistics.gap.campaign_gap import read_gap
from wil_campaign.plugins.statistics.gap.gap import CampaignGap
from wil_campaign.plugins.statistics.object_speeds import ObjectSpeed, read_object_speeds
from wil_campaign.plugins.statistics.pass_rates import PassRates, pass_rates
from wil_campaign.plugins.statistics.published import PublishedCounts, published_counts_of

SCHEMA = "wil/statistics/1"
FILE_NAME = "statistics.json"


@dataclass(frozen=True, slots=True)
class Study:
    """The statistics of one campaign. published: counts of another source, shown beside.

    speeds: of moving objects, by case and mode.
    """

    rates: PassRates
    gap: CampaignGap
    published: PublishedCounts = field(default_factory=PublishedCounts)
    speeds: tuple[ObjectSpeed, ...] = ()

    @classmethod
    def read(cls, folder: Path, campaign: CampaignDocuments | None = None) -> Self:
        """Return the statistics of a results folder. campaign: its documents, if read already.

        Raises ResultsFolderError.
        """
        documents = read_campaign_documents(folder) if campaign is None else campaign
        runs = [entry.result for entry in documents.entries if entry.result is not None]
        published = published_counts_of(documents.manifest.get("document"))
        return cls(
            pass_rates(runs),
            read_gap(folder, documents.entries),
            published,
            read_object_speeds(folder, documents.entries),
        )


def study_json(documents: CampaignDocuments, study: Study) -> str:
    """Return the statistics of a campaign as the text of statistics.json."""
    return to_json(
        {
            "schema": SCHEMA,
            "campaign": documents.name,
            "folder": documents.folder,
            "pass_rates": [asdict(rate) for rate in study.rates.rates],
            "tests": [asdict(test) for test in study.rates.tests],
            "agreement": [asdict(agreement) for agreement in study.rates.agreement],
            "gap": [asdict(figure) for figure in study.gap.figures],
            "gap_energy": [asdict(energy) for energy in study.gap.energies],
            "object_speeds": [asdict(speed) for speed in study.speeds],
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
