"""What the plugin run_images adds: images of a run that people share."""

from wil_campaign.hooks import ReportImage, implements


@implements
def report_images() -> tuple[ReportImage, ...]:
    """Return the card, and the moving picture."""
    return (
        ReportImage(
            "card",
            "wil_campaign.plugins.run_images.image_writer:write_card",
            "Write card.png into the folder of a run too: its moment as one picture to share, with "
            "the real, twin and mixed image, the plan, and the verdict.",
        ),
        ReportImage(
            "gif",
            "wil_campaign.plugins.run_images.image_writer:write_moving_picture",
            "Write flight.gif into the folder of a run too: its flight as a moving picture.",
        ),
    )
