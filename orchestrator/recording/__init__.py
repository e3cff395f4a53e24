"""Recording of one run: files that grow in place and stay readable when cut off."""
