"""One network in plain arithmetic, in tiles and in cooperative vectors: the course's hardware-acceleration section."""
