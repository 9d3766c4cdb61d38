"""The program accepts the commands that the pages show; none of them is run."""

import re
import shlex
from pathlib import Path

import click
import pytest

from bagpipe.cli.__main__ import main
from bagpipe.cli.verb import Verb

ROOT = Path(__file__).parents[3]
NOTES = ROOT / "charts/bagpipe/templates/NOTES.txt"
# The reference is the program's own help.
REFERENCE = ROOT / "docs/reference/cli.md"
PAGES = [ROOT / "README.md", NOTES, *sorted((ROOT / "docs").rglob("*.md"))]
LINE = re.compile(r"^(?: {4,}|\$ )(?:\S*bin/|kubectl )?bagpipe (?=[a-z-])(.+)$", re.MULTILINE)
WORDS = [
    pytest.param(found[1], id=f"{page.relative_to(ROOT)}: {found[1]}")
    for page in PAGES
    if page != REFERENCE
    for found in LINE.finditer(page.read_text())
]


@pytest.mark.parametrize("line", WORDS)
def test_the_program_understands_it(line: str) -> None:
    # Behind the words come a comment, a pipe or a file for what is written.
    line = re.split(r" {2,}#| [|>] ", re.sub(r"\{\{.*?\}\}", "", line))[0]
    name, *words = shlex.split(line)
    if name.startswith("--"):
        assert name in ("--help", "--version")
        return
    verb = main.commands[name]
    assert isinstance(verb, Verb)
    command = verb.load()
    if isinstance(command, click.Group):
        command = command.commands[words.pop(0)]
    # Raises UsageError where it does not. Below the program's own context, as commands keep -h.
    parent = click.Context(main, info_name="bagpipe", **main.context_settings)
    command.make_context(name, words, parent=parent)


@pytest.mark.parametrize(
    ("page", "verbs"),
    [
        ("README.md", {"run", "submit", "pull"}),
        ("docs/start.md", {"plan", "watch", "logs"}),
        ("charts/bagpipe/templates/NOTES.txt", {"submit"}),
    ],
)
def test_a_first_page_names_the_verbs_that_one_begins_with(page: str, verbs: set[str]) -> None:
    assert {found[1].split()[0] for found in LINE.finditer((ROOT / page).read_text())} >= verbs
