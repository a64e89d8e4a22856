"""The one exception for input that a user can mend."""

from warp_neural.kernels.errors import InputError

__all__ = ["InputError"]
