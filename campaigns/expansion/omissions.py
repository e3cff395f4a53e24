"""Requirements of a campaign that the command line leaves out, so that a PASS cannot hide them."""

from collections.abc import Collection, Iterator, Mapping
from functools import partial

from campaigns.expansion.case_reader import collect_problems
from campaigns.expansion.controls import modes_of
from campaigns.schema import CampaignPart
from campaigns.values.acceptance import DECIDED, Share, parse_share
from worlds.files.documents import Document, check
from worlds.files.yaml_nodes import mapping_node

_REQUIRING = ("modes", "cases", "controls", "repetitions", "oracles", "accept")
"""Keys of a campaign file that say what it requires."""


def left_out(
    original: Document,
    document: Document,
    part: CampaignPart,
    chosen: Collection[tuple[str, str]],
    shares: Mapping[tuple[str, str], Share],
) -> tuple[str, ...]:
    """Return the omissions of a run: what the file requires and the options leave out.

    original: the file as it is written. document, part: with --set, --seed and --repetitions, and
    with what its bench defines. chosen: the cases and controls, with their modes, to be flown.
    shares: the required share of each.
    """
    was = _as_written(original, document, part)
    left = list(_runs(was, part, chosen, shares))
    fewer = was.most_repetitions - part.most_repetitions
    if fewer > 0:
        left.append(f"{fewer} of {was.most_repetitions} repetitions")
    if part.sequential_test != was.sequential_test and was.sequential_test is not None:
        left.append("the sequential test of the repetitions")
    left += [
        f"the control {name}/{mode}"
        for name, control in was.controls.items()
        for mode in modes_of(was, control)
        if (name, mode) not in chosen
    ]
    left += [f"the oracle {name}" for name in was.oracles if name not in part.oracles]
    return tuple(left)


def _as_written(original: Document, document: Document, part: CampaignPart) -> CampaignPart:
    """Return the campaign with what its file requires as it is written.

    A value that is valid only with the options requires nothing by itself.
    """
    for key in _REQUIRING:
        if original.get((key,)) != document.get((key,)):
            written = _with_key_of(original, document, key)
            found = collect_problems([], partial(check, written, CampaignPart))
            if found is not None:
                part = part.model_copy(update={key: getattr(found, key)})
    return part


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
    was: CampaignPart,
    part: CampaignPart,
    chosen: Collection[tuple[str, str]],
    shares: Mapping[tuple[str, str], Share],
) -> Iterator[str]:
    """Yield required cases and modes that the command line's options omit or weaken."""
    for (case, mode), share in _required_shares(was).items():
        now = shares.get((case, mode))
        if now is None or (case, mode) not in chosen:
            yield f"{case}/{mode}"
        elif now.passes < share.scaled(part.most_repetitions).passes:
            yield f"{case}/{mode} {share} (only {now})"


def _required_shares(part: CampaignPart) -> dict[tuple[str, str], Share]:
    """Return the required share of passes by case and mode, to find omissions."""
    whole = Share(part.most_repetitions, part.most_repetitions)
    if part.accept is None:
        return {(case, mode): whole for case in part.cases for mode in part.modes}
    return {
        (case, mode): whole if text == DECIDED else parse_share(text)
        for case, shares in part.accept.items()
        for mode, text in shares.items()
    }
