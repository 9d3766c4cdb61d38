"""What a reader sees of the program in its page: commands with what they print.

A transcript is a fenced block `console` below a verb's help. What differs from run to run is named
here, and is all that may differ between the page and the program.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import click

from bagpipe.cli.__main__ import main
from bagpipe.cli.verb import Verb

PAGE = Path(__file__).parents[1] / "docs/reference/cli.md"
# The page's words for the test's own folder and namespace.
FOLDER = "/home/robin/drives"
NAMESPACE = "robots"
FENCE = re.compile(r"^```console\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
SECTION = re.compile(r"^##+ (.+)\n((?:(?!^##+ ).*\n?)*)", re.MULTILINE)
# What is looked for, and the word that stands for it. Spaces follow the widest of a column.
DIFFERS = [
    (re.compile(r"\b20\d\d-\d\d-\d\dT\d\d:\d\d:\d\dZ"), "TIME"),
    (re.compile(r"\b20\d\d-\d\d-\d\d to 20\d\d-\d\d-\d\d\b"), "DAYS"),
    (re.compile(r"^\d\d:\d\d:\d\d\b", re.MULTILINE), "CLOCK"),
    (re.compile(r"\b[0-9a-f]{12}(?=\.bag\b)"), "ATTEMPT"),
    (re.compile(r"(?<=ed) +\d+\.\d(?= |$)", re.MULTILINE), " SECONDS"),
    (re.compile(r"^slow: \S+, \d+\.\d s$", re.MULTILINE), "slow: CASE, SECONDS"),
    (re.compile(r"(?<=\.html: )[\d,]+ bytes"), "SIZE"),
    (re.compile(r"(?<= files, )[\d.]+ [KM]iB in [\d.]+ s$", re.MULTILINE), "SIZE in SECONDS"),
    (re.compile(r" +"), " "),
]


@dataclass(frozen=True)
class Step:
    """A line for the shell, and what is printed."""

    line: str
    printed: str


def verbs() -> list[str]:
    """What the program can be asked for, by itself and below a group."""
    found = []
    for name in main.list_commands(click.Context(main)):
        verb = main.commands[name]
        assert isinstance(verb, Verb)
        command = verb.load()
        below: list[str] = []
        if isinstance(command, click.Group):
            below = command.list_commands(click.Context(command))
        found += [f"{name} {each}" for each in below] or [name]
    return found


def transcripts(page: str) -> dict[str, str]:
    """The transcript's text of each section that has one, by the section's title."""
    found = {title: FENCE.search(text) for title, text in SECTION.findall(page)}
    return {title: block[1] for title, block in found.items() if block}


def steps(transcript: str) -> list[Step]:
    """The commands of a transcript; a line that ends in a backslash goes on."""
    parts = re.split(r"^\$ ", transcript, flags=re.MULTILINE)
    assert not parts[0], f"a transcript begins with a command: {parts[0]!r}"
    made = []
    for part in parts[1:]:
        lines = part.split("\n")
        count = next(n for n, line in enumerate(lines, 1) if not line.endswith("\\"))
        made.append(Step("\n".join(lines[:count]), "\n".join(lines[count:])))
    return made


def alike(text: str) -> str:
    """Text without what differs from run to run."""
    for pattern, word in DIFFERS:
        text = pattern.sub(word, text)
    return "\n".join(line.rstrip() for line in text.splitlines())


def replaced(page: str, title: str, transcript: str) -> str:
    """The page with another transcript in a section that has one."""
    head = re.search(rf"^##+ {title}$", page, re.MULTILINE)
    assert head, f"the page has no section {title}"
    start = page.index("```console\n", head.end())
    end = page.index("\n```\n", start)
    return f"{page[:start]}```console\n{transcript.rstrip()}{page[end:]}"
