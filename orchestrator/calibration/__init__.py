"""A real camera measured: pictures of a board and poses in, a calibration file out."""
