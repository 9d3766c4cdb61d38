"""`bagpipe pull`: the results of a job in the cluster, copied to this machine."""

import re
import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import click
from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

from bagpipe.cli.cluster.faults import ClusterError
from bagpipe.cli.cluster.place import Place, job_names, place_options
from bagpipe.cli.cluster.results_of import ended_job
from bagpipe.cli.cluster.state import Json
from bagpipe.cli.cluster.watching import Seconds
from bagpipe.cli.places import RefusedError, folders, output_option, print_as, volume_option
from bagpipe.cli.pulling.entry import Entry, PullError, chosen, ordered
from bagpipe.cli.pulling.pod import Claimed, claimed, manifest
from bagpipe.cli.pulling.stored import StoredFolder
from bagpipe.cli.pulling.target import Origin, Target, target_at
from bagpipe.cli.terminal import plain
from bagpipe.quantities import size
from bagpipe.report.stored import LINES, MANIFEST, StoredResults
from bagpipe.row_facts import recorded_names
from bagpipe.storage import Storage, StorageError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bagpipe.cli.cluster.api import Cluster

_WORDS = re.compile(r"(?:job|simjob|simulationjobs?)(?:\.sim\.bagpipe\.io)?")
_MOST_SHOWN = 5


class Folder(Protocol):
    """A results folder elsewhere. Every method raises PullError."""

    def listed(self) -> tuple[list[Entry], list[str]]:
        """The files that can be copied, and the names of what can't."""

    def sent(self, wanted: Sequence[Entry]) -> "Iterator[tuple[Entry, Iterator[bytes]]]":
        """Each wanted file with its pieces."""


@dataclass(frozen=True)
class _Wanted:
    """What the command line says beside the job and the folder."""

    only: list[str]
    volumes: dict[str, str]
    image: str
    timeout: float
    start_timeout: float


@dataclass(frozen=True)
class _Pulled:
    folder: Path
    files: int
    bytes: int
    here: int
    left_out: list[str]
    missing: list[str]


@click.command("pull")
@click.argument("name", metavar="JOB", shell_complete=job_names)
@click.argument("target", metavar="[TARGET]", required=False, type=click.Path(path_type=Path))
@place_options
@click.option(
    "--only",
    "patterns",
    multiple=True,
    metavar="FILES",
    help="Only these, such as report.html,results.jsonl or 'cases/night-0004*'. May be repeated.",
)
@click.option(
    "--timeout", type=Seconds(), default="1h", show_default=True,
    help="For all of it; a pod that was left behind ends so long after its start.",
)  # fmt: skip
@click.option(
    "--start-timeout", type=Seconds(), default="3m", show_default=True,
    help="For the pod that reads a claim to run.",
)  # fmt: skip
@click.option(
    "--image", default="", metavar="IMAGE",
    help="Of that pod, with python3.  [default: the image of the job's driver]",
)  # fmt: skip
@volume_option
@output_option
def pull_command(
    name: str, target: Path | None, place: Place, patterns: tuple[str, ...],
    volumes: tuple[str, ...], output: str, **given: Any,
) -> None:  # fmt: skip
    """Copy the results of a JOB that has ended to the folder TARGET, or bagpipe-results/JOB.

    JOB is a job's name, job/NAME, or NAMESPACE/NAME. Results on a claim come through a pod that
    this makes and removes: it mounts the claim read-only, in the image of the job's driver, without
    rights and without a token. All other results are read from this machine, with the credentials
    of its environment.

    A file appears when it is whole, the manifest last. Nothing that is in TARGET is replaced. Call
    it again after an interruption, and only what is missing is copied.

    The exit status is 0 if all that was asked for is here, and 2 if not.

    \b
    bagpipe pull nightly
    bagpipe pull robots/nightly results-of-tonight
    bagpipe pull nightly -n robots --only report.html,results.jsonl
    """
    try:
        wanted = _Wanted(
            [each for listed in patterns for each in listed.split(",") if each],
            folders(volumes), given["image"], given["timeout"], given["start_timeout"],
        )  # fmt: skip
    except StorageError as error:
        raise RefusedError(str(error)) from error
    job, place = named(name, place)
    cluster = place.cluster()
    found = cluster.job(job)
    state = ended_job(found)
    origin = Origin(state.namespace, state.name, state.uid, state.results)
    folder = target or Path("bagpipe-results", state.name)
    with target_at(folder, origin) as to, _folder(cluster, found, wanted) as source:
        pulled = _copy(source, to, wanted.only, shown=output == "table")
    _show(pulled, output)
    raise SystemExit(2 if pulled.left_out or pulled.missing else 0)


def named(written: str, place: Place) -> tuple[str, Place]:
    """A job's name without the words before it, and where it is. Raises RefusedError."""
    before, slash, name = written.rpartition("/")
    if not slash or _WORDS.fullmatch(before):
        return name, place
    if "/" in before or not before or not name:
        raise RefusedError(f"{written}: write a job's name, job/NAME, or NAMESPACE/NAME")
    if place.namespace not in (None, before):
        raise RefusedError(
            f"{written} says namespace {before} and -n says {place.namespace}: leave one out"
        )
    return name, Place(place.context, before)


def _folder(cluster: "Cluster", job: Json, wanted: _Wanted) -> AbstractContextManager[Folder]:
    """The results where they lie. Raises PullError and ClusterError."""
    uri = str(job["status"]["results"])
    if uri.startswith("pvc://"):
        where = claimed(uri)
        if where is None:
            raise PullError(f"status.results of the job is no folder on a claim: {plain(uri)}")
        if where.claim not in wanted.volumes:
            return _through_a_pod(cluster, job, where, wanted)
    until = time.monotonic() + wanted.timeout
    return nullcontext(StoredFolder(uri, Storage(wanted.volumes), until))


def _through_a_pod(
    cluster: "Cluster", job: Json, where: Claimed, wanted: _Wanted
) -> AbstractContextManager[Folder]:
    # They need the client's library, which only verbs about a cluster load.
    from bagpipe.cli.cluster.pods import Pods  # noqa: PLC0415
    from bagpipe.cli.pulling.claim import Limits, check_rights, claim_folder  # noqa: PLC0415

    pods = Pods(cluster)
    check_rights(pods)
    driver = _driver(pods, str(job["status"].get("driver") or ""), wanted.image)
    made = manifest(job, driver, wanted.image, where.claim, wanted.timeout)
    limits = Limits(wanted.start_timeout, wanted.timeout)
    return claim_folder(pods, made, where, limits, lambda text: click.echo(text, err=True))


def _driver(pods: Any, name: str, image: str) -> Json:
    """The job's driver, else the namespace's latest one; empty where an image was given instead."""
    try:
        if name:
            found: Json = pods.get(name)
            return found
    except ClusterError as error:
        if error.status != 404:
            raise
    try:
        drivers: list[Json] = pods.drivers()
    except ClusterError as error:
        if error.status != 403:
            raise
        drivers = []
    if drivers or image:
        return next(iter(drivers), {})
    raise PullError(
        "no pod of a driver is left, whose image could read the claim: give --image IMAGE, one with"
        " python3 that the cluster may run"
    )


def _copy(source: Folder, to: Target, only: list[str], *, shown: bool) -> _Pulled:
    """Copies what is not here yet. Raises PullError."""
    entries, left_out = source.listed()
    wanted = ordered(chosen(entries, only))
    missing = to.missing(wanted)
    to.check_room(missing)
    whole = sum(entry.size for entry in missing)
    console = Console(stderr=True, emoji=False)
    begun = time.monotonic()
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        DownloadColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, disable=not shown or not console.is_terminal) as bar:
        task = bar.add_task(f"{len(missing):,} files", total=whole)
        for entry, pieces in source.sent(missing):
            with to.file(entry) as write:
                for piece in pieces:
                    write(piece)
                    bar.advance(task, len(piece))
    seconds = time.monotonic() - begun
    click.echo(f"{len(missing):,} files, {size(whole)} in {seconds:.1f} s", err=True)
    lacking = [] if only else _lacking(to.folder, {entry.name for entry in entries})
    return _Pulled(
        to.folder,
        len(missing),
        whole,
        len(wanted) - len(missing),
        [] if only else left_out,
        lacking,
    )


def _lacking(folder: Path, have: set[str]) -> list[str]:
    """What a manifest stands for and the folder did not have: the lines, and recordings."""
    if MANIFEST not in have:
        return []
    try:
        manifest = StoredResults(f"file://{folder.resolve()}", Storage({})).manifest()
        # A driver that committed and could not publish leaves a manifest alone.
        names = [LINES, *(name for case in manifest["cases"] for name in recorded_names(case))]
        return [name for name in names if "://" not in name and name not in have]
    except (
        StorageError, LookupError, TypeError, ValueError, AttributeError, RecursionError,
    ) as error:  # fmt: skip
        raise PullError(f"{folder / MANIFEST} is no manifest of results: {error}") from error


def _show(pulled: _Pulled, output: str) -> None:
    for words, names in (
        ("not copied, being no file or of a name that none has here", pulled.left_out),
        ("not there, though the manifest names them", pulled.missing),
    ):
        if names:
            some = ", ".join(repr(name) for name in names[:_MOST_SHOWN])
            more = ", ..." if len(names) > _MOST_SHOWN else ""
            click.echo(f"{len(names):,} {words}: {some}{more}", err=True)
    if output != "table":
        print_as(
            {
                "folder": str(pulled.folder), "files": pulled.files, "bytes": pulled.bytes,
                "alreadyHere": pulled.here, "notCopied": pulled.left_out,
                "notThere": pulled.missing,
            },
            output,
        )  # fmt: skip
        return
    click.echo(plain(str(pulled.folder)))
    page = pulled.folder / "report.html"
    if page.is_file():
        click.echo(f"page: {plain(str(page))}")
