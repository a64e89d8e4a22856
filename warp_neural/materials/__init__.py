"""Materials as sets of maps, and the shader that they are for."""
