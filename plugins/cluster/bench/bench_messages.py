"""Names by which the node of a bench and its server know each other's data."""

SOCKET_VARIABLE = "WIL_BENCH_SOCKET"
"""In the environment of the bench's node: the Unix socket of the bench's server."""
TEXT, FILE = "bench_text", "bench_file"
"""Among the facts of a bench's node: the bench file's content, and its path there."""
