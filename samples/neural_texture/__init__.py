"""A material in a neural texture, from a latent texture to a codec, one idea a step."""
