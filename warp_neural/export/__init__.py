"""Networks as source text for programs without Python: `export`."""

from warp_neural.export.folder import TARGETS, export

__all__ = ["TARGETS", "export"]
