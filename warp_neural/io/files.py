"""Files are written whole or not at all, and all that a command wrote can be taken back."""

import os
import platform
import secrets
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from warp_neural.errors import InputError

_HOST = f".wn-{zlib.crc32(platform.node().encode()):08x}-"  # temporary files: this, the process, random letters


class Written:
    """What `atomic_path` has written since `recording` began."""

    def __init__(self) -> None:
        self.before: dict[Path, Path | None] = {}
        """of each file a link to the one that it replaced, if any"""
        self.folders: list[Path] = []

    def keep(self) -> None:
        """For good."""
        for old in filter(None, self.before.values()):
            old.unlink(missing_ok=True)

    def remove(self, path: Path) -> None:
        """With what was there before."""
        old = self.before.pop(path)
        for each in filter(None, (old, path)):
            each.unlink(missing_ok=True)
        remove_empty(self.folders)

    def take_back(self, path: Path) -> None:
        """As it was, or gone, and the folders with it that were made and are empty now."""
        old = self.before.pop(path)
        if old:
            os.replace(old, path)
        else:
            path.unlink(missing_ok=True)
        remove_empty(self.folders)


_recordings: list[Written] = []


@contextmanager
def recording() -> Iterator[Written]:
    written = Written()
    _recordings.append(written)
    try:
        yield written
    finally:
        _recordings.remove(written)


@contextmanager
def atomic_path(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path beside `path`, with its suffix; on success it replaces `path`, on any error it goes.

    Temporary files that killed processes have left beside it go too. Raises `InputError` naming the folder if it cannot
    be made or written, or what `path` is if it is no file: as root a device such as /dev/null could be replaced.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: a folder or device, no file that could be replaced; give another name")
    made = [folder for folder in (path.parent, *path.parent.parents) if not folder.exists()][::-1]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = _temporary(path)
        _remove_left(path.parent)
    except OSError as error:
        remove_empty(made)
        raise InputError(
            f"{path}: cannot write here ({error.strerror}); choose a folder that can be written"
        ) from error
    try:
        yield temporary
        olds = [(written, _linked(path)) for written in _recordings if path not in written.before]
        os.replace(temporary, path)
        for written, old in olds:
            written.before[path] = old
            written.folders += made
        made = []
    except OSError as error:
        raise InputError(f"{path}: could not be written ({error.strerror}); nothing was changed") from error
    finally:
        temporary.unlink(missing_ok=True)
        remove_empty(made)


def check_target(path: Path | str) -> None:
    """Raise `InputError` now if `atomic_path` cannot write there; nothing is left."""
    with suppress(_Enough), atomic_path(path):
        raise _Enough


class _Enough(Exception):
    pass


def _temporary(path: Path) -> Path:
    temporary = path.with_name(f"{_HOST}{os.getpid()}-{secrets.token_hex(6)}{path.suffix}")
    os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))  # the umask takes its part
    return temporary


def _linked(path: Path) -> Path | None:
    """The file as it is now by another name; None if there is none, or links are not to be had."""
    old = _temporary(path)
    old.unlink()
    try:
        os.link(path, old)
    except OSError:
        return None
    return old


def _remove_left(folder: Path) -> None:
    """Temporary files of processes of this machine that run no more."""
    for path in folder.glob(f"{_HOST}*-*"):
        process = path.name.removeprefix(_HOST).partition("-")[0]
        if process.isdecimal() and not _runs(int(process)):
            path.unlink(missing_ok=True)


def _runs(process: int) -> bool:
    if os.name == "nt":  # there a signal of 0 would end it
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        pass
    return True


def remove_empty(folders: list[Path]) -> None:
    """Innermost last."""
    for folder in reversed(folders):
        with suppress(OSError):
            folder.rmdir()
