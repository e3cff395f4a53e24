"""What the plugin mqtt adds."""

from wil_campaign.hooks import Command, OperatorChannel, RunOption, implements


@implements
def commands() -> tuple[Command, ...]:
    """Return the command `sign`."""
    return (
        Command(
            "sign",
            "wil_campaign.plugins.mqtt.sign_command:sign",
            "Sign an operator's command for MQTT.",
            "operate",
        ),
    )


@implements
def operator_channels() -> tuple[OperatorChannel, ...]:
    """Return the channel by MQTT."""
    return (
        OperatorChannel(
            "mqtt",
            part="wil_campaign.plugins.mqtt.mqtt_setup:MqttPart",
            open="wil_campaign.plugins.mqtt.mqtt_channel:open_mqtt",
            examine="wil_campaign.plugins.mqtt.broker_findings:broker_findings",
            machine="wil_campaign.plugins.mqtt.broker_findings:machine_findings",
            summary="The broker for reports and commands; by default none.",
        ),
    )


@implements
def run_options() -> tuple[RunOption, ...]:
    """Return the option that names the broker."""
    return (
        RunOption(
            "broker",
            key="operator.mqtt.broker",
            help="An MQTT broker: mqtt://host, mqtts://host, or embedded, which starts one on this "
            "machine.",
        ),
    )
