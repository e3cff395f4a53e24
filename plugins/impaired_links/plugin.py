"""What the plugin impaired_links adds."""

from wil_campaign.hooks import LinkLayerKind, RunObserver, implements


@implements
def run_observers() -> tuple[RunObserver, ...]:
    """Return the key `links`."""
    return (
        RunObserver(
            "links",
            field="wil_campaign.plugins.impaired_links.links_part:links_field",
            setup="wil_campaign.plugins.impaired_links.links_part:links_setup",
            observe="wil_campaign.plugins.impaired_links.link_outages:observe",
        ),
    )


@implements
def link_layers() -> tuple[LinkLayerKind, ...]:
    """Return the simulated radio."""
    return (LinkLayerKind("links", "wil_campaign.plugins.impaired_links.impaired:Radio"),)
