"""Device code of neural textures: grids of latents read by trained kernels, and their training."""
