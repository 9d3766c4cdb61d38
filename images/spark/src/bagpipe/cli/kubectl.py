"""`kubectl bagpipe`: the same program, found by kubectl as kubectl-bagpipe on PATH."""

import sys

import click
from click.shell_completion import ShellComplete

from bagpipe.cli.__main__ import main as program

_NAME = "kubectl bagpipe"
# Cobra's ShellCompDirective: let the shell complete file names, or don't.
_FILES, _NO_FILES = ":0", ":4"


def main() -> None:
    """The entry point kubectl-bagpipe."""
    program(prog_name=_NAME)


def complete() -> None:
    """The entry point kubectl_complete-bagpipe.

    kubectl gives the words after `kubectl bagpipe`, the last of them unfinished or empty, and reads
    a proposal per line and at last what the shell may add.
    """
    click.echo("\n".join(proposals(sys.argv[1:])))


def proposals(words: list[str]) -> list[str]:
    """What may stand in place of the last word, and the directive for the shell."""
    *before, incomplete = words or [""]
    shell = ShellComplete(program, {}, _NAME, "")
    found = shell.get_completions(before, incomplete)
    values = [
        f"{item.value}\t{item.help}" if item.help else str(item.value)
        for item in found
        if item.type == "plain"
    ]
    return [*values, _FILES if any(item.type != "plain" for item in found) else _NO_FILES]
