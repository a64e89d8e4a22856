"""Encodings: what stands between a network's inputs and its first layer. Each is a frozen dataclass; see `Encoding`."""

from kernels.encodings.base import Encoding
from kernels.encodings.frequency import Frequency, Identity

__all__ = ["Encoding", "Frequency", "Identity"]
