"""What a real camera is: its optics by pictures of a board, its mounting and latency in motion."""
