"""docs/reference/cli.md is the program's own help.

`BAGPIPE_WRITE_REFERENCE=1 pytest tests/unit/cli` writes it.
"""

import os
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.cli.verb import Verb
from tests.transcripts import PAGE, Step, alike, steps, transcripts, verbs

ROOT = Path(__file__).parents[3]
HEAD = """\
# bagpipe

The program for people: what a job would run, and what became of it. It is installed with the Python
package `bagpipe` and its extras `jobs`, `storage` and `cli`; the verb `run` needs the extra `run`,
too, and `run --spark` the extra `spark`. In a checkout, `make venv` puts it at `.venv/bin/bagpipe`.
`kubectl bagpipe` is the same program ([plugin](../tasks/kubectl-plugin.md)).
This page is the program's own help, with a transcript of each verb; tests compare them
with the program. The transcripts' folder has a recording of a PR2's joints (`recordings/pr2`), a
copy of it that was cut off (`cut.bag`), two jobs over it (`released.yaml`, `pr-812.yaml`), and in
`bagpipe-results` what became of them. Times, seconds, the sizes of a page and of
what is pulled, and attempts' names differ from run to run, and nothing else does.

| exit status | meaning |
|---|---|
| 0 | passed; or nothing is worse; or what was asked for is written |
| 1 | Failed or Invalid; a variant is worse; cases, or what `doctor` seeks, lack; a damaged bag |
| 2 | it could not be read or run, or there is no verdict; or the program has a fault of its own |
| 130 | Ctrl-C ended it; a job in the cluster goes on |

`BAGPIPE_TRACEBACK=1` in the environment shows where a fault of the program is.

Commands that read storage take credentials from the environment
([storage](storage.md#credentials)); `--volume CLAIM=FOLDER` says which folder of this machine
stands for a claim. Commands that ask a cluster use kubectl's kubeconfig, or inside of a pod its
account.
"""


def helped(*arguments: str) -> str:
    ended = CliRunner().invoke(main, [*arguments, "--help"], prog_name="bagpipe")
    assert ended.exit_code == 0
    return f"```\n{ended.output.rstrip()}\n```\n"


def page() -> str:
    """The whole page, by a program that has done nothing else; transcripts stay as they are."""
    kept = transcripts(PAGE.read_text())

    def section(*words: str) -> list[str]:
        shown = kept.get(" ".join(words))
        return [helped(*words), *([f"```console\n{shown}```\n"] if shown else [])]

    parts = [HEAD, helped()]
    for name in main.list_commands(click.Context(main)):
        parts += [f"## {name}\n", *section(name)]
        verb = main.commands[name]
        assert isinstance(verb, Verb)
        command = verb.load()
        if isinstance(command, click.Group):
            for below in command.list_commands(click.Context(command)):
                parts += [f"### {name} {below}\n", *section(name, below)]
    return "\n".join(parts)


def test_the_reference_is_the_program_s_own_help() -> None:
    # A process of its own: a command keeps the names of its help option from its first use.
    program = "from tests.unit.cli.test_reference import page; print(page(), end='')"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    if os.environ.get("BAGPIPE_WRITE_REFERENCE"):
        PAGE.write_text(done.stdout)
    assert PAGE.read_text() == done.stdout, "BAGPIPE_WRITE_REFERENCE=1 pytest tests/unit/cli"


@pytest.mark.parametrize("group", [(), ("bag",)], ids=["bagpipe", "bag"])
def test_the_list_of_verbs_says_each_whole_summary(group: tuple[str, ...]) -> None:
    _, heading, listed = helped(*group).partition("\nCommands:\n")
    assert heading
    assert "..." not in listed


@pytest.mark.parametrize("verb", verbs())
def test_each_verb_has_a_transcript_of_itself(verb: str) -> None:
    """That it is what is printed shows tests/integration/control_plane/test_transcripts.py."""
    shown = steps(transcripts(PAGE.read_text()).get(verb, ""))
    assert any(step.line.startswith(f"bagpipe {verb} ") and step.printed for step in shown)


def test_a_transcript_is_commands_and_what_each_prints() -> None:
    assert steps("$ a \\\n    b\nc\nd\n$ e; echo $?\n1\n") == [
        Step("a \\\n    b", "c\nd\n"),
        Step("e; echo $?", "1\n"),
    ]
    with pytest.raises(AssertionError, match="begins with a command"):
        steps("printed\n$ a\n")


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (" a-1  failed  22.3   Why", " a-1  failed   1.0  Why", True),
        (" a-1  failed  22.3   Why", " a-1  passed  22.3   Why", False),
        ("a-1 has 22.3 m", "a-1 has 22.4 m", False),
        ("cases/a-1.6c4f978b5405.bag", "cases/a-1.000000000000.bag", True),
        ("cases/a-1.6c4f978b5405.bag", "cases/a-2.6c4f978b5405.bag", False),
        ("page.html: 73,604 bytes", "page.html: 8 bytes", True),
        ("part.bag: 73,604 bytes", "part.bag: 8 bytes", False),
        ("2026-11-24T21:50:39Z passed", "2027-01-01T00:00:00Z passed", True),
        ("10 files, 1.75 MiB in 0.1 s", "10 files, 1.80 MiB in 2.3 s", True),
        ("10 files, 1.75 MiB in 0.1 s", "9 files, 1.75 MiB in 0.1 s", False),
        ("slow: a-1, 24.6 s", "slow: a-2, 1.0 s", True),
    ],
)
def test_only_what_is_named_may_differ(one: str, other: str, same: bool) -> None:
    assert (alike(one) == alike(other)) is same
