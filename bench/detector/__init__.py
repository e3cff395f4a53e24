"""The training of the shipped detector: images, network, file. Nothing of it flies."""
