"""`bagpipe list`: the results below a folder, newest first."""

import posixpath
from typing import Any

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from bagpipe.cli.places import (
    RefusedError,
    folders,
    output_option,
    print_as,
    uri_of,
    volume_option,
)
from bagpipe.cli.terminal import plain
from bagpipe.report.stored import MANIFEST, ManifestUnreadableError, StoredResults
from bagpipe.row_facts import verdict_words
from bagpipe.storage import Storage, StorageError

_JOURNAL = "journal"
UNREADABLE = "its manifest can't be read"
# <output.uri>/<job>/<uid>, and a folder of several such output.uris.
_DEEPEST = 3
_MOST_FOLDERS = 2000
# Names that are no folder's; of any other it is asked what is in it.
_FILES = frozenset({".bag", ".mcap", ".db3", ".json", ".jsonl", ".html", ".log", ".yaml", ".part"})
_COLOURS = {"Passed": "green", "Failed": "red", "Invalid": "yellow"}


@click.command("list")
@click.argument("where", metavar="FOLDER", default=".")
@volume_option
@output_option
def list_command(where: str, volumes: tuple[str, ...], output: str) -> None:
    """List the results below FOLDER, newest first, with their verdicts.

    FOLDER is a folder of this machine, such as ./bagpipe-results, or a URI, such as a job's
    output.uri. Results lie in it, or at most three folders deeper. Of each only the head of its
    manifest is read.

    \b
    bagpipe list bagpipe-results
    bagpipe list s3://results/lane --output json | jq '.[0].results'
    """
    try:
        known = folders(volumes)
        found = results_below(uri_of(where, known), Storage(known))
    except StorageError as error:
        raise RefusedError(str(error)) from error
    if output == "table":
        _show(found, Console(emoji=False))
    else:
        print_as(found, output)


def results_below(uri: str, storage: Storage) -> list[dict[str, Any]]:
    """What each folder of results says of itself, newest first. Raises StorageError."""
    found = []
    level = [uri]
    visited = 0
    for depth in range(_DEEPEST + 1):
        below: list[str] = []
        for folder in level:
            visited += 1
            if visited > _MOST_FOLDERS:
                raise StorageError(
                    f"{uri} has more than {_MOST_FOLDERS} folders: name one that lies deeper"
                )
            names = storage.names(folder)
            if MANIFEST in names or _JOURNAL in names:
                found.append(described(folder, storage, MANIFEST in names))
            elif depth < _DEEPEST:
                below += [
                    posixpath.join(folder, name)
                    for name in names
                    if posixpath.splitext(name)[1] not in _FILES
                ]
        level = below
    return sorted(found, key=lambda each: (each["ended"], each["results"]), reverse=True)


def described(folder: str, storage: Storage, committed: bool) -> dict[str, Any]:
    """One folder of results; without a manifest the job still runs, or was interrupted."""
    empty: dict[str, Any] = {"job": "", "phase": "", "verdict": "", "ended": "", "counts": {}}
    if not committed:
        return {"results": folder} | empty | {"note": "it has no manifest: it runs, or was ended"}
    try:
        manifest = StoredResults(folder, storage).head()
        return {
            "results": folder,
            "job": str(manifest["job"]["name"]),
            "phase": str(manifest["phase"]),
            "verdict": str(manifest.get("verdict") or ""),
            "ended": str((manifest.get("provenance") or {}).get("ended") or ""),
            "counts": manifest["counts"],
            "note": "",
        }
    except (ManifestUnreadableError, KeyError, TypeError, AttributeError):
        return {"results": folder} | empty | {"note": UNREADABLE}


def _show(found: list[dict[str, Any]], console: Console) -> None:
    table = Table(box=None, header_style="bold")
    for column in ("Ended", "Job", "Verdict"):
        table.add_column(column)
    table.add_column("Results", overflow="fold")
    for each in found:
        words = each["note"] or verdict_words(each["verdict"], each["counts"])
        colour = _COLOURS.get(each["verdict"], "dim")
        table.add_row(
            escape(plain(each["ended"])),
            escape(plain(each["job"])),
            f"[{colour}]{escape(plain(words))}[/]",
            escape(plain(each["results"].removeprefix("file://"))),
        )
    console.print(table)
    if not found:
        console.print("no results are there")
