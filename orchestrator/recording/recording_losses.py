"""What a recording may lack before the run proves nothing; pure."""

from collections.abc import Iterable

from orchestrator.recording.mcap.mcap_writer import TopicLoss

_OF_THE_VERDICT = ("/provenance", "/visibility")
"""Parts of /mixed/<sensor>: what the mixture as evidence is judged by."""


def excessive_loss(losses: Iterable[TopicLoss], *, max_loss: float) -> str:
    """Return in words what is missing beyond the limit; empty when nothing is.

    max_loss: which share of a topic may be missing. Of what the verdict rests on nothing may be.
    """
    said = [
        f"{loss.lost} of {loss.offered} of {loss.topic}"
        for loss in losses
        if loss.lost > loss.offered * (0.0 if _rests_on(loss.topic) else max_loss)
    ]
    limit = f"more than {max_loss:.3g} of a topic, or any of what the verdict rests on"
    return f"run.mcap lacks {', '.join(said)}: {limit}" if said else ""


def _rests_on(topic: str) -> bool:
    return topic.startswith("/mixed/") and topic.endswith(_OF_THE_VERDICT)
