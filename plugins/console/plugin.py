"""What the plugin console adds."""

from wil_campaign.hooks import Command, LiveView, implements


@implements
def commands() -> tuple[Command, ...]:
    """Return the commands `console`, `watch` and `fence`."""
    return (
        Command(
            "console",
            "wil_campaign.plugins.console.console_command:console",
            "Show runs in flight, or a finished run, in the browser.",
            "operate",
        ),
        Command(
            "watch",
            "wil_campaign.plugins.console.watch_command:watch",
            "Show the runs in flight on this machine until they end.",
            "operate",
        ),
        Command(
            "fence",
            "wil_campaign.plugins.console.fence_command:fence",
            "Send new fences to the vehicles in flight.",
            "operate",
        ),
    )


@implements
def live_views() -> tuple[LiveView, ...]:
    """Return the console beside a flight."""
    return (
        LiveView(
            "console",
            "wil_campaign.plugins.console.console_beside:console_beside",
            "A page in the browser to watch the flight and to stop it: HOST, HOST:PORT or :PORT of "
            "this machine; auto for a free port of 127.0.0.1; ADDRESS,CERTIFICATE,KEY (PEM files) "
            "for browsers of other machines. Its links are printed.",
            "wil_campaign.plugins.console.feed.console_feed:ConsoleFeed",
        ),
    )
