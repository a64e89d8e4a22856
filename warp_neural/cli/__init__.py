"""What every command shares: options and their ranges, devices, progress, `--json`, how it ends and what it leaves."""

import json
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from threading import current_thread, main_thread
from typing import Any

import warp as wp

from warp_neural.cli.ending import StoppedError, check_cache, ending
from warp_neural.cli.options import (
    FOLDER,
    Between,
    CommonConfig,
    Count,
    Options,
    Positive,
    Samples,
    Side,
    TrainingConfig,
    resolve_device,
)
from warp_neural.cli.parsing import again, parse
from warp_neural.cli.printing import lines_of, lines_of_files, printable, progress
from warp_neural.cli.training import check_resume, train
from warp_neural.io.files import Written, check_target, recording, remove_empty

__all__ = [
    "Between",
    "CommonConfig",
    "Count",
    "Options",
    "Positive",
    "Samples",
    "Side",
    "TrainingConfig",
    "progress",
    "resolve_device",
    "run",
    "train",
]


def run(
    main: Callable[[Any], dict], config_class: type, args: list[str] | None = None, prog: str | None = None
) -> dict:
    """Parse `config_class` from the command line, call `main(config)`, print its metrics and the files it made.

    `InputError` becomes one line on stderr and exit code 2, everything else that ends a command a line and a code of
    its own (`warp_neural.cli.ending`). Of a command that fails no file is left, of one that is stopped its checkpoints.
    With `--json` all but the metrics that would reach stdout, native output too, goes to stderr.
    """
    wp.config.log_level = wp.LOG_WARNING  # no line for every module that is compiled or loaded
    printable()
    with ending(), _interruptible():
        config = parse(config_class, args, prog)
        check_cache()
        check_resume(config)
        with recording() as written:
            metrics = _metrics(main, config, written)
            _finish(written)
        if config.json:
            print(json.dumps(metrics))
        else:
            for line in (*lines_of(metrics), *lines_of_files(written.before)):
                print(line)
    return metrics


def _metrics(main: Callable[[Any], dict], config: Any, written: Written) -> dict:
    try:
        if isinstance(getattr(config, "out", None), Path) and isinstance(config, CommonConfig):
            check_target(config.out / "metrics.json")
        if not config.json:
            return main(config)
        with _stdout_to_stderr():
            return main(config)
    except BaseException as error:
        stopped = isinstance(error, KeyboardInterrupt)
        _take_back(written, checkpoints=not stopped)
        if stopped and written.before:
            raise StoppedError(f"go on with: {again('--resume')}") from None
        raise


def _take_back(written: Written, checkpoints: bool) -> None:
    for path in list(written.before):
        if checkpoints or path.parent.name != FOLDER:
            written.take_back(path)
    written.keep()


def _finish(written: Written) -> None:
    """Keeps what was written, but for checkpoints: nothing is left to go on with."""
    for path in list(written.before):
        if path.parent.name == FOLDER:
            written.remove(path)
            remove_empty([path.parent])
    written.keep()


@contextmanager
def _interruptible() -> Iterator[None]:
    """Ctrl-C raises `KeyboardInterrupt`; until here it ended a command at once."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN and current_thread() is main_thread():
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield


@contextmanager
def _stdout_to_stderr() -> Iterator[None]:
    if sys.stdout is None or sys.stderr is None:
        yield
        return
    sys.stdout.flush()
    saved = os.dup(1)
    os.dup2(2, 1)  # native code writes to the descriptor, Python to the object
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        os.dup2(saved, 1)
        os.close(saved)
