"""An embedded vehicle in a process of its own: both ends, and the feed between them."""
