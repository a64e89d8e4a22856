"""Bytes of a file in sections: each its length, its content and the CRC-32 of both."""

import zlib
from pathlib import Path

from warp_neural.errors import InputError

REMEDY = "the file is damaged, write or copy it again"


def unsigned(number: int) -> bytes:
    """Seven bits a byte, the lowest first, with 128 added to all but the last."""
    result = bytearray()
    while number > 127:
        result.append(number & 127 | 128)
        number >>= 7
    result.append(number)
    return bytes(result)


def section(content: bytes, before: bytes = b"") -> bytes:
    """before: what comes first and is checked too."""
    whole = before + unsigned(len(content)) + content
    return whole + zlib.crc32(whole).to_bytes(4, "little")


class FileBytes:
    """The bytes of a file, read when they are asked for. Raises `InputError` that names it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_file():
            raise InputError(f"{path}: no such file; check the name")
        self.size = path.stat().st_size

    def __len__(self) -> int:
        return self.size

    def __getitem__(self, part: slice) -> bytes:
        try:
            with open(self.path, "rb") as file:
                file.seek(part.start)
                return file.read(part.stop - part.start)
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read ({error.strerror}); check its permissions") from error


class Reader:
    """Goes through bytes; all that is wrong is an `InputError` that names the file and the part."""

    def __init__(self, path: Path, part: str, data: bytes | FileBytes) -> None:
        self.path, self.part, self.data, self.at = path, part, data, 0

    def require(self, condition: bool, problem: str) -> None:
        if not condition:
            raise InputError(f"{self.path}: {self.part}: {problem}; {REMEDY}")

    def bytes(self, n: int) -> bytes:
        self.require(len(self.data) - self.at >= n, f"cut short at {len(self.data) - self.at} of {n} bytes")
        self.at += n
        return self.data[self.at - n : self.at]

    def byte(self) -> int:
        return self.bytes(1)[0]

    def unsigned(self) -> int:
        """Up to 2^35 - 1."""
        result = 0
        for shift in range(0, 35, 7):
            byte = self.byte()
            result |= (byte & 127) << shift
            if byte < 128:
                return result
        self.require(False, "a number has no end")
        raise AssertionError

    def rest(self) -> bytes:
        return self.bytes(len(self.data) - self.at)

    def end(self) -> None:
        self.require(self.at == len(self.data), f"{len(self.data) - self.at} bytes too many")

    def section(self, part: str, start: int | None = None) -> "Reader":
        """start: where what is checked begins, here if None."""
        start, self.part = self.at if start is None else start, part
        content = self.bytes(self.unsigned())
        crc = zlib.crc32(self.data[start : self.at])
        self.require(int.from_bytes(self.bytes(4), "little") == crc, "its checksum does not match")
        return Reader(self.path, part, content)
