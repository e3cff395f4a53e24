"""Operators follow and command a campaign by MQTT."""
