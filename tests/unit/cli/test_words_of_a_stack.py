"""A stack's words reach no terminal as commands."""

from pathlib import Path

import pytest

from bagpipe.cli import logs, replay
from bagpipe.cli.cluster.pod_logs import kept
from tests.unit.bagpipe.jobs import make_row

# Goes up two lines, wipes them, and writes another outcome in their place; and sets the clipboard.
EVIL = "\x1b[2A\x1b[2K\rpassed\x1b]52;c;cm0gLXJmIH4=\x07"


def test_logs_show_a_stack_s_lines_and_obey_none(capsys: pytest.CaptureFixture[str]) -> None:
    row = make_row("a", "failed", "StackCrashed", stderr=["fine", EVIL])
    logs._show(kept(row, "results"), "table")
    assert "\x1b" not in capsys.readouterr().out


def test_replay_shows_a_stack_s_lines_and_obeys_none(capsys: pytest.CaptureFixture[str]) -> None:
    again = make_row("a", "failed", "StackCrashed", stderr=[EVIL], message=EVIL)
    replay._show(make_row("a"), again, Path("x/fragment.bag"))
    assert "\x1b" not in capsys.readouterr().out
