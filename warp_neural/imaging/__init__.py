"""Images on disk from and to arrays; densities from images."""
