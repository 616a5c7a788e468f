"""`rovtwin evidence ...`, or another command, as a user types it."""

import sys

import pytest

import rovtwin.cli


def run(monkeypatch, capsys, *words, command="evidence"):
    """Exit code, standard output and standard error."""
    monkeypatch.setattr(sys, "argv", ["rovtwin", command, *map(str, words)])
    with pytest.raises(SystemExit) as stopped:
        rovtwin.cli.main()
    shown = capsys.readouterr()
    return stopped.value.code or 0, shown.out, shown.err
