"""What the plugin ros2 adds."""

from wil_campaign.hooks import (
    AutonomyKind,
    Command,
    RecordingFormat,
    StarterOption,
    implements,
)


@implements
def autonomy_kinds() -> tuple[AutonomyKind, ...]:
    """Return the kind `ros2`."""
    return (
        AutonomyKind(
            "ros2",
            value="a node",
            field="wil_campaign.plugins.ros2.ros2_autonomy:ros2_field",
            setup="wil_campaign.plugins.ros2.ros2_autonomy:Ros2Autonomy",
            open="wil_campaign.plugins.ros2.node_flight:open_node",
            noun="ROS 2 node",
        ),
    )


@implements
def commands() -> tuple[Command, ...]:
    """Return the command `export`."""
    return (
        Command(
            "export",
            "wil_campaign.plugins.ros2.bags.export_command:export",
            "Write a recorded run as a bag of ROS 2.",
        ),
    )


@implements
def recording_formats() -> tuple[RecordingFormat, ...]:
    """Return bags of ROS 2."""
    return (
        RecordingFormat(
            "ros2",
            trouble="wil_campaign.plugins.ros2.bags.bag_file_of_run:trouble",
            write="wil_campaign.plugins.ros2.bags.bag_file_of_run:write",
        ),
    )


@implements
def starter_options() -> tuple[StarterOption, ...]:
    """Return the option of `init` for a campaign with a node."""
    return (
        StarterOption(
            "ros2",
            "wil_campaign.plugins.ros2.starter:node_files",
            "Write a campaign whose autonomy is a ROS 2 node, with such a node.",
        ),
    )
