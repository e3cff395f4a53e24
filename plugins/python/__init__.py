"""What the public Python module is made of: campaigns loaded, flown and read by programs."""
