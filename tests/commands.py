"""The command line as a person meets it."""

import sys

from cyclopean import cli


def run(monkeypatch, capsys, *words):
    """Exit status, output and errors of ``cyclopean WORDS``."""
    monkeypatch.setattr(sys, "argv", ["cyclopean", *map(str, words)])
    status = 0
    try:
        cli.main()
    except SystemExit as stop:
        status = stop.code or 0
    captured = capsys.readouterr()
    assert "Traceback" not in captured.out + captured.err
    return status, captured.out, captured.err
