"""`bagpipe delete`: removes results, and nothing else that lies beside them."""

import contextlib
import posixpath
from pathlib import Path
from typing import Any

import click

from bagpipe.cli.list import described
from bagpipe.cli.places import RefusedError, folders, uri_of, volume_option
from bagpipe.cli.pulling.entry import MARKER
from bagpipe.cli.run_folder import without_run
from bagpipe.cli.running import RunError
from bagpipe.cli.terminal import plain
from bagpipe.report.stored import BEGUN, FILES, FOLDERS, LOGS, MANIFEST
from bagpipe.row_facts import verdict_words
from bagpipe.storage import Storage, StorageError


@click.command("delete")
@click.argument("where", metavar="RESULTS...", nargs=-1, required=True)
@volume_option
@click.option("--yes", is_flag=True, help="Don't ask.")
def delete_command(where: tuple[str, ...], volumes: tuple[str, ...], yes: bool) -> None:
    """Remove the RESULTS of jobs that have ended: folders of this machine, or URIs.

    What a job leaves is removed, its recordings among it; other files of the folder stay, and so
    does the job's object in a cluster. A folder into which a run is writing is refused, and so is
    one without a manifest: its job may run.

    \b
    bagpipe delete bagpipe-results/lane
    bagpipe delete s3://results/lane/nightly/0c1f... --yes
    """
    try:
        known = folders(volumes)
        storage = Storage(known)
        chosen = [_looked_at(uri_of(each, known), storage) for each in where]
        for found in chosen:
            click.echo(_words(found), err=True)
        if not yes and not _confirmed(len(chosen)):
            raise RefusedError("nothing is removed")
        for found in chosen:
            count = _remove(found, storage)
            click.echo(f"{found['results'].removeprefix('file://')}: {count} files are removed")
    except (StorageError, RunError) as error:
        raise RefusedError(str(error)) from error


def _looked_at(uri: str, storage: Storage) -> dict[str, Any]:
    names = storage.names(uri)
    if MANIFEST not in names:
        raise StorageError(
            f"{uri} has no {MANIFEST}: it holds no results, or those of a job that runs or was"
            " ended before it had any: remove such a folder by hand"
        )
    return described(uri, storage, committed=True)


def _words(found: dict[str, Any]) -> str:
    state = found["note"] or verdict_words(found["verdict"], found["counts"])
    where = found["results"].removeprefix("file://")
    return plain(f"{where}: {found['job']} {found['ended']} {state}")


def _confirmed(count: int) -> bool:
    try:
        return click.confirm(f"Remove {'it' if count == 1 else f'these {count}'}?", err=True)
    except click.Abort:
        # Nobody is there to answer, or it was Ctrl-C.
        return False


def _remove(found: dict[str, Any], storage: Storage) -> int:
    """As remove_results, if they are still those that were shown. Raises RunError, too."""
    folder = _on_this_machine(found["results"], storage)
    with without_run(folder) if folder else contextlib.nullcontext():
        if _looked_at(found["results"], storage) != found:
            raise StorageError(
                f"{found['results']} has other results than those that were shown: nothing of them"
                " is removed"
            )
        return remove_results(found["results"], storage)


def remove_results(uri: str, storage: Storage) -> int:
    """Removes what a job left in a folder; how many files that were. Raises StorageError.

    The manifest goes last: a deletion that was interrupted is gone on with by the same command.
    Behind it only that by whose lock no run begins meanwhile.
    """
    there = set(storage.names(uri))
    doomed = [posixpath.join(uri, name) for name in (*FILES, *LOGS, MARKER) if name in there]
    for folder in FOLDERS:
        below = posixpath.join(uri, folder)
        doomed += [posixpath.join(below, name) for name in storage.names(below)]
    doomed.append(posixpath.join(uri, MANIFEST))
    for each in doomed:
        storage.remove(each)
    for folder in FOLDERS:
        _remove_empty(posixpath.join(uri, folder), storage)
    if BEGUN in there:
        storage.remove(posixpath.join(uri, BEGUN))
    _remove_empty(uri, storage)
    return len(doomed) + (BEGUN in there)


def _remove_empty(uri: str, storage: Storage) -> None:
    """On object storage there are no folders."""
    if path := _on_this_machine(uri, storage):
        with contextlib.suppress(OSError):
            path.rmdir()


def _on_this_machine(uri: str, storage: Storage) -> Path | None:
    """The path of what a URI names; None where it lies elsewhere."""
    if uri.startswith("file://"):
        return Path(uri.removeprefix("file://"))
    if uri.startswith("pvc://"):
        claim, _, rest = uri.removeprefix("pvc://").partition("/")
        return Path(storage.volumes[claim], rest)
    return None
