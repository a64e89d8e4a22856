"""A picture in a tiny network, from 9 parameters to a latent texture: the course's network section."""
