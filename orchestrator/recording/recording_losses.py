"""How much a recording may lack before its run is INVALID; pure."""

from collections.abc import Iterable

from wil_campaign.orchestrator.recording.mcap.mcap_writer import TopicLoss

_EVIDENCE_PARTS = ("/provenance", "/visibility")
"""Parts of /mixed/<sensor> that are evidence for the verdict."""


def excessive_loss(losses: Iterable[TopicLoss], *, max_loss: float) -> str:
    """Return in words what is missing beyond the limit; empty when nothing is.

    max_loss: which share of a topic may be missing. Evidence for the verdict must be complete.
    """
    excessive = [
        f"{loss.lost} of {loss.offered} of {loss.topic}"
        for loss in losses
        if loss.lost > loss.offered * (0.0 if _is_evidence(loss.topic) else max_loss)
    ]
    limit = f"more than {max_loss:.3g} of a topic, or any evidence for the verdict"
    return f"run.mcap lacks {', '.join(excessive)}: {limit}" if excessive else ""


def _is_evidence(topic: str) -> bool:
    return topic.startswith("/mixed/") and topic.endswith(_EVIDENCE_PARTS)
