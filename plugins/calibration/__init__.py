"""Camera calibration: from images of a board, and poses, to a calibration file."""
