"""The statistics in a campaign's report: the comparison of its modes, and statistics.json."""

from pathlib import Path

from wil_campaign.hooks import Section
from wil_campaign.orchestrator.reading.model import CampaignDocuments
from wil_campaign.orchestrator.report.rendering.overview import stand_in_notice
from wil_campaign.orchestrator.report.rendering.page_parts import page_environment
from wil_campaign.plugins.statistics.conclusions import study_conclusions
from wil_campaign.plugins.statistics.gap.gap import CampaignGap
from wil_campaign.plugins.statistics.pass_rates import PassRates
from wil_campaign.plugins.statistics.study import FILE_NAME, Study, study_json
from wil_campaign.plugins.statistics.study_tables import (
    energy_rows,
    gap_rows,
    has_modes_to_compare,
    result_rows,
    speed_rows,
    study_statements,
)
from wil_campaign.plugins.statistics.study_text import study_text


def study_section(folder: Path, documents: CampaignDocuments) -> Section:
    """Return the statistics of a results folder as a section of its report."""
    study = _study(folder, documents)
    return Section(
        html=_html(documents, study),
        problems=study.gap.left_out,
        files={FILE_NAME: study_json(documents, study)},
        text=study_text(study) if has_modes_to_compare(study) else "",
    )


def _study(folder: Path, documents: CampaignDocuments) -> Study:
    try:
        return Study.read(folder, documents)
    except Exception as error:  # noqa: BLE001 - a damaged file may raise anything
        why = f"the gap cannot be measured: {type(error).__name__}: {error}"
        return Study(PassRates((), (), ()), CampaignGap(left_out=(why,)))


def _html(documents: CampaignDocuments, study: Study) -> str:
    template = page_environment("wil_campaign.plugins.statistics").get_template("study.html.j2")
    return template.render(
        results=result_rows(study),
        gap=gap_rows(study),
        energies=energy_rows(study),
        speeds=speed_rows(study),
        statements=study_statements(study),
        conclusions=study_conclusions(study),
        stand_in=stand_in_notice(documents),
    )
