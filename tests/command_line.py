"""Commands as a user calls them: what `--json` prints, and the one line of a refusal."""

import json

import pytest
import warp as wp

from warp_neural.cli.commands import main


def run(capfd, *args):
    capfd.readouterr()
    main([*args, "--json"])
    (line,) = capfd.readouterr().out.splitlines()
    return json.loads(line, parse_constant=pytest.fail)


def refused(capfd, *args):
    wp.init()  # says once that there is no driver
    capfd.readouterr()
    with pytest.raises(SystemExit) as exit_info:
        main(list(args))
    assert exit_info.value.code == 2
    captured = capfd.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1, captured.err
    return captured.err
