"""What is on board a vehicle: parameters, missions, fences, logs, GPS receiver."""
