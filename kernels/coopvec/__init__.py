"""Cooperative vectors: matrix products of the vectors that single threads hold, on tensor cores where there are any."""
