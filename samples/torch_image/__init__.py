"""A picture learned in PyTorch, as tiny-cuda-nn's example does."""
