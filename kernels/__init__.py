"""Device code of Warp Neural: `wp.func`s and kernels, importable into any Warp program.

No arrays, files or seeds live here.
"""

__warp_neural__ = True  # tells this package from the unrelated PyPI package of the same name
