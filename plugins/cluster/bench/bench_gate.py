"""What a bench accepts: orders for its own vehicle, as many as its operator consented to; pure.

Messages from the network pass this check before they reach anything that flies.
"""

from wil_campaign.campaigns.setup.bench_file import Bench
from wil_campaign.campaigns.setup.bench_resolution import departure
from wil_campaign.plugins.cluster.node_messages import ConsentAsked, RunOrdered, ToNode


class BenchGate:
    """Counts the flights of one campaign that a person at the bench has consented to."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._consented: ConsentAsked | None = None
        self._flown = 0

    def open_for(self, asked: ConsentAsked) -> None:
        """Accept a person's consent; it replaces an earlier one."""
        self._consented, self._flown = asked, 0

    def refusal(self, message: ToNode) -> str:
        """Return why a message is not passed on to the bench's runs; "" where it is.

        A flight back to the start belongs to the run before it.
        """
        if not isinstance(message, RunOrdered):
            return ""
        order, consented = message.order, self._consented
        if consented is None:
            return f"nobody at bench {self._bench.name} has consented to this campaign"
        if order.arm and not consented.arm:
            return f"bench {self._bench.name} has consent for a campaign that does not arm"
        if order.back is None:
            self._flown += 1
            if self._flown > consented.runs:
                return f"bench {self._bench.name} has consent for {consented.runs} runs, not more"
        return departure(order.plan.files.campaign, self._bench)
