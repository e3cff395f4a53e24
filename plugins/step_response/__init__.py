"""Step responses by which vehicles are compared with firmwares: flight, figures, ranges."""
