"""World files: what they may say, and the scenes that they describe."""
