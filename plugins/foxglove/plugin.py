"""What the plugin foxglove adds."""

from wil_campaign.hooks import LiveView, implements


@implements
def live_views() -> tuple[LiveView, ...]:
    """Return Foxglove beside a flight."""
    return (
        LiveView(
            "foxglove",
            "wil_campaign.plugins.foxglove.bridge_beside:foxglove_beside",
            "Send runs in flight live to Foxglove, which only displays: HOST, HOST:PORT or :PORT "
            "of loopback; auto for 127.0.0.1:8765. It needs the extra foxglove.",
        ),
    )
