"""Limits for the files of users: sizes after decoding, counts and depths.

Each is checked before memory is allocated for the data that it limits. docs/security.md lists them.
"""

MAX_IMAGE_BYTES = 100_000_000
"""Of an image file."""
MAX_IMAGE_PIXELS = 40_000_000
"""Of a decoded image or a frame of a video: 7680 x 5200."""
MAX_MESH_BYTES = 200_000_000
"""Of a mesh file, and of each file that it names."""
MAX_MESH_PARENTS = 3
"""Folders above a mesh file in which files may lie that it names."""
MAX_MESH_FACES = 500_000
"""Of all instances of all meshes of a file."""
MAX_MESH_VALUES = 6_000_000
"""Of vertices, indices and other elements in a file, before instances."""
MAX_MESH_NODES = 100_000
"""Of a scene graph, instances counted."""
MAX_MESH_DEPTH = 100
"""Of a scene graph."""
MAX_CHUNK_BYTES = 256_000_000
"""Of a chunk of an MCAP file after decompression, and of any record."""
MAX_CHUNK_RECORDS = 500_000
"""Of a chunk of an MCAP file."""
MAX_MESSAGE_VALUES = 5_000_000
"""Of a JSON message in an MCAP file, and of a document of a results folder: its commas, brackets
and braces."""
MAX_RESULTS_BYTES = 256_000_000
"""Of a document, a log or a trajectory of a results folder; a summary of 9,000 runs has 140 MB."""
MAX_TRAJECTORY_ROWS = 500_000
"""Of a trajectory.csv: an hour of both vehicles at 50 Hz is 360,000."""
MAX_NETWORK_BYTES = 500_000_000
"""Of an ONNX file."""
