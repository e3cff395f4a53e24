"""Steps of recipes beyond those that lay virtual objects over real images."""
