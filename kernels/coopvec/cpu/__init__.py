"""C++ text of networks for the CPU."""
