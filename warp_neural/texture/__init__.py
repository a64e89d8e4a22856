"""`wn.texture`: textures of a material compressed into latents and one tiny network."""
