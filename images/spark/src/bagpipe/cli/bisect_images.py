"""`bagpipe bisect --images`: the first bad one of a list of images, by jobs in the cluster."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from bagpipe.cli.cluster.faults import ClusterError
from bagpipe.cli.cluster.place import Place
from bagpipe.cli.first_bad import Found, found, next_look, wrong_end
from bagpipe.cli.images_tried import Trial, Tried, images_between
from bagpipe.cli.judged_step import Word
from bagpipe.cli.manifest import ManifestError, read_object
from bagpipe.cli.places import RefusedError, folders, print_as, uri_of
from bagpipe.cli.terminal import plain
from bagpipe.storage import StorageError

_MOST_BYTES = 1 << 20
_MOST_IMAGES = 10_000
_COLOURS = {"good": "green", "bad": "red", "unknown": "yellow"}
_INTERRUPTED = 130


@dataclass(frozen=True)
class Images:
    """What the command line says of a search."""

    good: str
    bad: str
    listed: Path
    cases: tuple[str, ...]
    rounds: int
    seconds: float
    volumes: tuple[str, ...]
    place: Place
    output: str


def search(manifest: Path, wanted: Images) -> int:
    """Search, and show what was tried; the exit status.

    0 where one image is the first bad one, 1 where it is one of several, 2 where an end is wrong or
    the cluster refuses, and 130 after Ctrl-C. Raises RefusedError where nothing can be searched.
    """
    trial, images = _begun(manifest, wanted)
    tried: dict[int, Tried] = {}
    words: dict[int, Word] = {}
    status = _INTERRUPTED
    try:
        while (number := next_look(len(images), words)) is not None:
            tried[number] = Tried(images[number])
            trial.look(tried[number])
            words[number] = tried[number].step.word
            _line(f"{images[number]} is {words[number]}: {tried[number].step.why}")
        wrong = wrong_end(len(images), words)
        answer = None if wrong else found(len(images), words)
        sentence = wrong or _sentence(images, answer)
        status = 2 if answer is None else int(len(answer.bad) > 1)
    except KeyboardInterrupt:
        answer, sentence = None, "interrupted"
    except ClusterError as error:
        answer, sentence, status = None, error.message, 2
    looks = [tried[number].as_json() for number in sorted(tried)]
    bad = [images[number] for number in answer.bad] if answer else []
    _show({"tried": looks, "firstBad": bad, "message": sentence}, wanted.output)
    return status


def _begun(manifest: Path, wanted: Images) -> tuple[Trial, list[str]]:
    """What is tried, and the images in order. Raises RefusedError before anything runs."""
    try:
        job, _ = read_object(manifest)
        known = folders(wanted.volumes)
        uri_of(str(_at(job, "output").get("uri") or ""), known)
    except (ManifestError, StorageError) as error:
        raise RefusedError(str(error)) from error
    if _at(job, "stack") == {}:
        raise RefusedError(f"{manifest}: spec.stack is missing")
    if job["spec"].get("variants"):
        raise RefusedError(
            f"{manifest} has variants, which may have images of their own: leave spec.variants out"
        )
    namespace = job["metadata"].get("namespace")
    place = wanted.place
    if namespace and place.namespace and namespace != place.namespace:
        raise RefusedError(
            f"the manifest says namespace {namespace} and -n says {place.namespace}: make them one"
        )
    images = images_between(wanted.good, wanted.bad, _listed(wanted.listed))
    cluster = Place(place.context, place.namespace or namespace).cluster()
    trial = Trial(job, wanted.cases, wanted.rounds, wanted.seconds, known, cluster, _line)
    return trial, images


def _line(text: str) -> None:
    click.echo(plain(text), err=True)


def _at(job: Mapping[str, Any], key: str) -> dict[str, Any]:
    """A map of the spec; empty for what is none."""
    spec = job.get("spec")
    part = spec.get(key) if isinstance(spec, dict) else None
    return part if isinstance(part, dict) else {}


def _listed(path: Path) -> list[str]:
    """The images of a file: one in a line, the oldest first; # begins a comment."""
    try:
        with click.open_file(str(path), "rb") as file:
            data = file.read(_MOST_BYTES + 1)
        lines = data.decode().splitlines()
    except OSError as error:
        raise RefusedError(f"{path} can't be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RefusedError(f"{path} is no text (byte {error.start})") from error
    images = [words[0] for line in lines if (words := line.partition("#")[0].split())]
    if len(data) > _MOST_BYTES or len(images) > _MOST_IMAGES:
        raise RefusedError(f"{path} has more than {_MOST_IMAGES:,} images or 1 MiB: give fewer")
    return images


def _sentence(images: Sequence[str], answer: Found | None) -> str:
    if answer is None:
        return ""
    good = f"{images[answer.good]}, the one before it, is good"
    if len(answer.bad) == 1:
        return f"{images[answer.bad[0]]} is the first bad one: {good}"
    named = ", ".join(images[number] for number in answer.bad)
    return (
        f"the first bad one is one of {len(answer.bad)}: {named}. {images[answer.good]} is good,"
        f" {images[answer.bad[-1]]} is bad, and what is between can't be judged"
    )


def _show(found: dict[str, Any], output: str) -> None:
    if output != "table":
        print_as(found, output)
        return
    console = Console(emoji=False)
    table = Table(box=None, header_style="bold")
    for column in ("Image", "", "Why", "Results"):
        table.add_column(column, overflow="fold")
    for each in found["tried"]:
        table.add_row(
            escape(plain(each["image"])), f"[{_COLOURS[each['word']]}]{each['word']}[/]",
            escape(plain(each["why"])), escape(plain(" ".join(each["results"]))),
        )  # fmt: skip
    console.print(table)
    console.print(escape(plain(found["message"])), highlight=False, soft_wrap=True)
