"""An embedded vehicle as a separate process: its settings, its main, and the feed to its parent."""
