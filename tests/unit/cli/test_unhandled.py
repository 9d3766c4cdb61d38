"""The program's message and exit status after an unexpected error, or Ctrl-C."""

import signal
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.cli.unhandled import UnhandledErrors
from bagpipe.installed import InstallationError
from bagpipe.native import NativeModuleError
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish

_MANIFEST_BYTES = 1 << 20


def test_an_unexpected_error_is_a_sentence_and_no_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = publish(tmp_path, [make_row("a-0")])
    (folder / "manifest.json").write_text("{}")
    monkeypatch.delenv("BAGPIPE_TRACEBACK", raising=False)
    ended = CliRunner().invoke(main, ["results", str(folder)])
    assert ended.exit_code == 2
    assert ended.stdout == ""
    (line,) = ended.stderr.splitlines()
    assert "KeyError: 'counts'" in line
    assert "BAGPIPE_TRACEBACK=1 shows where" in line
    ended = CliRunner(env={"BAGPIPE_TRACEBACK": "1"}).invoke(main, ["results", str(folder)])
    assert (ended.exit_code, "Traceback" in ended.stderr) == (2, True)


@pytest.mark.parametrize("shows_where", ["", "1"])
def test_a_terminal_obeys_no_word_of_an_unexpected_error(shows_where: str) -> None:
    @click.group(cls=UnhandledErrors)
    def program() -> None:
        pass

    @program.command()
    def fails() -> None:
        raise RuntimeError("\x1b]52;c;cm0gLXJmIH4=\x07") from ValueError("a\x1b]52;c;eA==\x07\nb")

    ended = CliRunner(env={"BAGPIPE_TRACEBACK": shows_where}).invoke(program, ["fails"])
    assert ended.exit_code == 2
    assert ("Traceback" in ended.stderr) == bool(shows_where)
    assert not {"\x1b", "\x07"} & set(ended.stderr)


@pytest.mark.parametrize(
    ("raised", "status", "sentence"),
    [
        (KeyboardInterrupt(), 130, "interrupted\n"),
        (MemoryError(), 2, "MemoryError"),
        (NativeModuleError("build it"), 2, "Error: build it\n"),
        (InstallationError("install it as a whole"), 2, "Error: install it as a whole\n"),
        (click.UsageError("write it otherwise"), 2, "Error: write it otherwise"),
        (click.ClickException("no"), 1, "Error: no"),
        (click.exceptions.Exit(3), 3, ""),
        (SystemExit(1), 1, ""),
        # Whoever reads no further knows why: no message is needed.
        (BrokenPipeError(32, "Broken pipe"), 1, ""),
    ],
)
def test_what_is_raised_and_how_it_ends(raised: BaseException, status: int, sentence: str) -> None:
    @click.group(cls=UnhandledErrors)
    def program() -> None:
        pass

    @program.command()
    def fails() -> None:
        raise raised

    ended = CliRunner(env={"BAGPIPE_TRACEBACK": ""}).invoke(program, ["fails"])
    assert (ended.exit_code, sentence in ended.stderr) == (status, True), ended.stderr
    assert ("unexpected" in ended.stderr) == isinstance(raised, MemoryError)


def test_ctrl_c_ends_a_verb_with_130() -> None:
    program = subprocess.Popen(
        [sys.executable, "-m", "bagpipe.cli", "submit", "-"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    with program:
        assert program.stdin is not None
        # It reads: so much does not fit into the pipe.
        program.stdin.write(b" " * _MANIFEST_BYTES)
        program.stdin.flush()
        program.send_signal(signal.SIGINT)
        # A signal that comes between two reads is seen only when the next one returns.
        program.stdin.close()
        assert program.stderr is not None
        status = program.wait(timeout=120)
        assert (status, program.stderr.read().strip()) == (130, b"interrupted")
