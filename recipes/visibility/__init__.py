"""Whether a mixture shows what stands only in the virtual world, measured in the mixture itself."""
