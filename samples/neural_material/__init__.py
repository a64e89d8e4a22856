"""A layered material as latents and a small network: three ways to train it, and what sizes cost."""
