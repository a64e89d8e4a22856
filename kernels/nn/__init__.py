"""What a network is, activations, losses, encodings, networks per thread and in tiles, optimizers."""
