"""Mixing without a flight: pictures, videos, and recordings that are mixed anew."""
