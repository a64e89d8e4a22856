"""How commands end, whatever is done to them: one line on stderr and an exit code, never a traceback."""

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import warp as wp

from warp_neural.errors import InputError

REFUSED, FAILED, STOPPED, CLOSED = 2, 1, 130, 141  # a shell's codes for Ctrl-C and a pipe that nobody reads
CACHE = "set WARP_CACHE_PATH to a folder that can be written"


class StoppedError(Exception):
    """By Ctrl-C; the message says what is left."""


@contextmanager
def ending() -> Iterator[None]:
    """Turns exceptions, those of a full or closed output too, into a line and `SystemExit`.

    `python -X dev` shows where an error came from that is none of the user's.
    """
    try:
        try:
            yield
        finally:
            _flush()
    except (KeyboardInterrupt, StoppedError) as error:
        code, line = STOPPED, "; ".join(["stopped", *map(str, error.args)])
    except InputError as error:
        code, line = REFUSED, f"error: {error}"
    except BrokenPipeError:
        code, line = CLOSED, ""
    except MemoryError:
        code, line = FAILED, "error: not enough memory; choose smaller sizes"
    except Exception as error:
        if sys.flags.dev_mode:
            raise
        code, line = FAILED, f"error: {describe(error)}"
    else:
        return
    _say(line)
    raise SystemExit(code) from None


def describe(error: Exception) -> str:
    text = " ".join(str(error).split())
    if wp.config.kernel_cache_dir and str(wp.config.kernel_cache_dir) in text:
        return f"Warp's cache of kernels: {text}; {CACHE}"
    if isinstance(error, OSError):
        return f"{error.filename or 'output'}: {error.strerror or text}"
    return f"{type(error).__name__}: {text[:300] or 'no message'} (python -X dev shows where)"


def check_cache() -> None:
    """Raise `InputError` if Warp cannot keep compiled kernels."""
    folder = os.environ.get("WARP_CACHE_PATH", "Warp's cache of kernels")
    try:
        wp.init()
        folder = wp.config.kernel_cache_dir
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"\0")
    except OSError as error:
        raise InputError(f"{folder}: no kernels can be kept here ({error.strerror}); {CACHE}") from error


def _flush() -> None:
    for stream in filter(None, (sys.stdout, sys.stderr)):
        try:
            stream.flush()
        except OSError:
            _silence(stream)  # or the interpreter tries again as it ends
            raise


def _say(line: str) -> None:
    if not line or sys.stderr is None:
        return
    with suppress(OSError):
        try:
            print(f"\n{line}" if line.startswith("stopped") and sys.stderr.isatty() else line, file=sys.stderr)
            sys.stderr.flush()
        except OSError:
            _silence(sys.stderr)


def _silence(stream) -> None:
    with suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)
