"""Requirements of a campaign: the required shares of `accept`, and cases of published counts."""

from collections.abc import Iterator, Mapping

from wil_campaign.campaigns.schema import CampaignPart
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.campaigns.values.acceptance import DECIDED, PassShare, parse_pass_share
from wil_campaign.campaigns.values.wanted_firmware import FIRMWARE
from wil_campaign.foundation.files.documents import Document, Problem, closest_word


def unknown_published_cases(base: Document, part: CampaignPart) -> Iterator[Problem]:
    """Yield the cases of published counts that the campaign does not have."""
    for case in part.published.passed if part.published is not None else ():
        if case not in part.cases:
            message = f"published names an unknown case '{case}'"
            path = ("published", "passed", case)
            yield base.problem(path, message, closest_word(case, part.cases), key=True)


def unflown_firmware(
    base: Document, part: CampaignPart, setups: Mapping[str, Case]
) -> Iterator[Problem]:
    """Yield the versions that `accept` requires of vehicles that fly in no mode."""
    flown = {name for case in setups.values() for mode in part.modes for name in case.flying(mode)}
    for name in part.wanted_firmware:
        if name not in flown:
            message = f"no mode flies '{name}': its version is never checked"
            yield base.problem(("accept", FIRMWARE, name), message, key=True)


def required_shares(
    original: Document, base: Document, part: CampaignPart, problems: list[Problem]
) -> dict[tuple[str, str], PassShare]:
    """Return the required share of passes of each expanded case and mode; all without `accept`.

    A share is written for the file's own repetitions. Where the command line changes them, it is
    scaled, rounded up: 4/5 of 1 is 1/1, of 10 it is 8/10.
    """
    whole = PassShare(part.most_repetitions, part.most_repetitions)
    if part.wanted_shares is None:
        return {(case, mode): whole for case in part.cases for mode in part.modes}
    written = original.get(("repetitions",), 1)
    found: dict[tuple[str, str], PassShare] = {}
    for case, shares in part.wanted_shares.items():
        if case not in part.cases:
            message = f"accept names an unknown case '{case}'"
            meant = closest_word(case, part.cases)
            problems.append(base.problem(("accept", case), message, meant, key=True))
            continue
        for mode, text in shares.items():
            path = ("accept", case, mode)
            share = whole if text == DECIDED else parse_pass_share(text)
            if mode not in part.modes:
                message = f"mode '{mode}' is not flown (modes: {', '.join(part.modes)})"
                problems.append(
                    base.problem(path, message, closest_word(mode, part.modes), key=True)
                )
            elif (text == DECIDED) != (part.sequential_test is not None):
                message = "'decided' and `repetitions: {until: decided, ...}` need each other"
                problems.append(base.problem(path, message))
            elif text != DECIDED and share.runs != written:
                message = f"{share} is of {share.runs} runs, but there are {written} repetitions"
                problems.append(base.problem(path, message))
            else:
                found[case, mode] = share.scaled(part.most_repetitions)
    return found
