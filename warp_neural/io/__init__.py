"""Files of tensors and networks: arrays in, arrays out."""
