"""Requirements of a campaign that the command line leaves out, so that a PASS cannot hide them."""

import json
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import partial

from wil_campaign.campaigns.expansion.case_reader import collect_problems
from wil_campaign.campaigns.expansion.controls import modes_of_control
from wil_campaign.campaigns.schema import CampaignPart, campaign_model
from wil_campaign.campaigns.schema.composition import CompositionPart
from wil_campaign.campaigns.setup.overrides import override_from_option
from wil_campaign.campaigns.values.acceptance import DECIDED, PassShare, parse_pass_share
from wil_campaign.foundation.files.documents import Document, check_document
from wil_campaign.foundation.files.problems import without_passwords
from wil_campaign.foundation.files.yaml_nodes import mapping_node

_REQUIRING = ("modes", "cases", "controls", "repetitions", "oracles", "accept")
"""Keys of a campaign file that say what it requires."""
_MOST_LETTERS = 120
"""Letters of what the file says in a key that the command line sets: `controls` is a page."""


def left_out_requirements(
    required: CampaignPart,
    part: CampaignPart,
    chosen: Collection[tuple[str, str]],
    shares: Mapping[tuple[str, str], PassShare],
) -> tuple[str, ...]:
    """Return the omissions of a run: what the file requires and the options leave out.

    required, part: the campaign as its file requires it, and with the options. chosen: the cases
    and controls, with their modes, to be flown. shares: the required share of each.
    """
    left = list(_runs(required, part, chosen, shares))
    fewer = required.most_repetitions - part.most_repetitions
    if fewer > 0:
        left.append(f"{fewer} of {required.most_repetitions} repetitions")
    test = required.sequential_test
    if test is not None and part.sequential_test != test:
        left.append("the sequential test of the repetitions")
    left += [
        f"the control {name}/{mode}"
        for name, control in required.controls.items()
        for mode in modes_of_control(required, control)
        if (name, mode) not in chosen
    ]
    left += [
        f"firmware {version} of {name}"
        for name, version in required.wanted_firmware.items()
        if part.wanted_firmware.get(name) != version
    ]
    left += [f"the oracle {name}" for name in required.oracles if name not in part.oracles]
    return tuple(left)


def set_option_caveats(sets: Iterable[str], original: Document | None) -> list[str]:
    """Return the caveats of --set options, with what the file says in its own keys.

    A limit may be among them: a PASS by it is no PASS of the file. original: the file as it is
    written; None where the options hold for several.
    """
    found = []
    for text in sets:
        override, value = override_from_option("--set", text), None
        if original is not None and override.file == "campaign":
            value = original.get(tuple(override.dotted_key.split(".")))
        in_file = json.dumps(value, ensure_ascii=False)
        if len(in_file) > _MOST_LETTERS:
            in_file = f"{in_file[: _MOST_LETTERS - 3]}..."
        stated = "" if value is None else f" (the file says {in_file})"
        found.append(without_passwords(f"set by the command line: {text}{stated}"))
    return found


def campaign_as_required(
    original: Document,
    document: Document,
    part: CampaignPart,
    composition: CompositionPart | None,
) -> CampaignPart:
    """Return a campaign with all that its own file and the composition that names it require.

    original: the file as it is written. document, part: with the options, and with what its bench
    defines. A value of the file that is valid only with the options requires nothing by itself.
    """
    for key in _REQUIRING:
        if original.get((key,)) != document.get((key,)):
            written = _with_key_of(original, document, key)
            found = collect_problems([], partial(check_document, written, campaign_model()))
            if found is not None:
                part = part.model_copy(update={key: getattr(found, key)})
    return part if composition is None else _with_composition(part, composition)


def _with_composition(part: CampaignPart, composition: CompositionPart) -> CampaignPart:
    """Return a part of a composition with the modes and repetitions of both."""
    given = composition.repetitions or 0
    own = part.repetitions
    most = max(given, part.most_repetitions)
    return part.model_copy(
        update={
            "modes": list(dict.fromkeys([*part.modes, *(composition.modes or ())])),
            "repetitions": most if isinstance(own, int) else own.model_copy(update={"most": most}),
        }
    )


def _with_key_of(original: Document, document: Document, key: str) -> Document:
    """Return a document whose top-level key is as in another one: its value, or not there."""
    keys = {name: document.entry((name,)) for name in _names(document) if name != key}
    if key in _names(original):
        keys[key] = original.entry((key,))
    return Document(document.path, mapping_node(keys, document.root.place))


def _names(document: Document) -> tuple[str, ...]:
    """Return the top-level keys of a document."""
    value = document.root.value
    return tuple(value) if isinstance(value, dict) else ()


def _runs(
    required: CampaignPart,
    part: CampaignPart,
    chosen: Collection[tuple[str, str]],
    shares: Mapping[tuple[str, str], PassShare],
) -> Iterator[str]:
    """Yield required cases and modes that the command line's options omit or weaken."""
    for (case, mode), share in _required_shares(required).items():
        now = shares.get((case, mode))
        if now is None or (case, mode) not in chosen:
            yield f"{case}/{mode}"
        elif now.passes < share.scaled(part.most_repetitions).passes:
            yield f"{case}/{mode} {share} (only {now})"


def _required_shares(part: CampaignPart) -> dict[tuple[str, str], PassShare]:
    """Return the required share of passes by case and mode, to find omissions."""
    whole = PassShare(part.most_repetitions, part.most_repetitions)
    if part.wanted_shares is None:
        return {(case, mode): whole for case in part.cases for mode in part.modes}
    return {
        (case, mode): whole if text == DECIDED else parse_pass_share(text)
        for case, shares in part.wanted_shares.items()
        for mode, text in shares.items()
    }
