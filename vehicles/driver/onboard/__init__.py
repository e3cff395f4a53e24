"""A vehicle's onboard data: parameters, missions, fences, logs, GPS receiver."""
