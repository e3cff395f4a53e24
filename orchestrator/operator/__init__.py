"""Operator commands and status reports: local socket, MQTT, and the campaign controller."""
