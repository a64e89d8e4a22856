"""`MLP`, its state, initialization, files; threads sorted by network."""
