"""Recording of one run: streams that append in place and stay readable when cut."""
