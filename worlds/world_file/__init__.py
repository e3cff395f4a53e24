"""World files: their schema, and the scenes that they describe."""
