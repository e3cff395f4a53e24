"""Motion capture by UDP and ZeroMQ."""
