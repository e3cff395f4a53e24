"""Campaigns from flight logs: origin, course, vehicle, firmware and parameters of a flight."""
