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

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs/reference/cli.md"
HEAD = """\
# bagpipe

The program for people: what a job would run, and what became of it. It is installed with the Python
package `bagpipe` and its extras `jobs`, `storage` and `cli`; the verb `run` needs the extra `run`,
too, and `run --spark` the extra `spark`. In a checkout, `make venv` puts it at `.venv/bin/bagpipe`.
`kubectl bagpipe` is the same program ([plugin](../tasks/kubectl-plugin.md)).
This page is the program's own help; a test compares them.

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
    """The whole page, by a program that has done nothing else."""
    parts = [HEAD, helped()]
    for name in main.list_commands(click.Context(main)):
        parts += [f"## {name}\n", helped(name)]
        verb = main.commands[name]
        assert isinstance(verb, Verb)
        command = verb.load()
        if isinstance(command, click.Group):
            for below in command.list_commands(click.Context(command)):
                parts += [f"### {name} {below}\n", helped(name, below)]
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
