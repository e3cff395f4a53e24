"""run.mcap: schemas, encoding, decoding and the file itself."""
