"""CUDA text of networks: tensor cores, and per-thread arithmetic."""
