"""Mixing without a flight: of images and videos, and replay of recorded runs."""
