"""A fused training step by `mma.sync`: 16-bit networks of up to 64 neurons, on every GPU with tensor cores."""
