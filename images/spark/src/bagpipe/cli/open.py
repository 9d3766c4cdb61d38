"""`bagpipe open`: one case as a recording that viewers show, with layouts for them."""

import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

import bagpipe
from bagpipe.cli.bag_here import Elsewhere, kind_of
from bagpipe.cli.bag_reading import BagFile, BagRefusedError
from bagpipe.cli.cluster.place import Place, place_options, results_places
from bagpipe.cli.cluster.results_of import results_of
from bagpipe.cli.places import RefusedError, folders, output_option, print_as, volume_option
from bagpipe.matrix.faults import MatrixError
from bagpipe.report.stored import Row, StoredResults
from bagpipe.run.laptop import ReplayError, local_spec, planned_case, write_fragment
from bagpipe.source.chosen import source_of
from bagpipe.storage import StorageError
from bagpipe.view.course import notes
from bagpipe.view.layouts import foxglove, plotjuggler, rviz
from bagpipe.view.moment import Moment, moments
from bagpipe.view.recording import Recording, write_view
from bagpipe.view.server import FileServer, foxglove_link

_BUDGET = 4 << 30
# What is shown before the moment at which something went wrong.
_BEFORE_SECONDS = 2.0


@dataclass(frozen=True)
class _Opened:
    file: Path
    layouts: list[Path]
    start: int
    end: int
    moment: Moment | None
    messages: int
    topics: list[dict[str, Any]]


@click.command("open")
@click.argument("case", metavar="CASE")
@click.option(
    "--results",
    "where",
    required=True,
    metavar="RESULTS",
    shell_complete=results_places,
    help="job/NAME for a job in the cluster, the URI in the job's status.results, or a folder.",
)
@place_options
@volume_option
@click.option("--at", type=float, metavar="SECONDS", help="From so long after the window's start.")
@click.option("--last", type=float, metavar="SECONDS", help="The last seconds of the window alone.")
@click.option("--topic", "topics", multiple=True, metavar="NAME", help="Of the recording only it.")
@click.option("--frame", default="map", show_default=True, help="RViz's fixed frame.")
@click.option(
    "--to",
    "folder",
    type=click.Path(path_type=Path, file_okay=False),
    help="Where the files go.  [default: ./CASE]",
)
@click.option("--serve", is_flag=True, help="Serve the file to a browser here, until Ctrl-C.")
@output_option
def open_command(
    case: str, where: str, place: Place, volumes: tuple[str, ...], folder: Path | None,
    serve: bool, output: str, **chosen: Any,
) -> None:  # fmt: skip
    """Put what a case was given, what its stack published and what was found into one MCAP file.

    It begins two seconds before the first criterion left its bounds, as far as that is known, and
    else with the window. The recording keeps its topics' names; where the stack published a topic
    of the same name, the recorded one is below /recorded. Courses of failed criteria are below
    /bagpipe/criteria, with their bounds. Layouts for Foxglove, PlotJuggler and RViz lie beside it.

    The exit status is 0 if the file was written, and 2 if not.

    \b
    bagpipe open night-0004-s2-pr-812 --results job/nightly -n robots
    bagpipe open night-0004 --results ./results --volume recordings=/data --last 10
    bagpipe open night-0004 --results ./results --volume recordings=/data --serve
    """
    if chosen["at"] is not None and chosen["last"] is not None:
        raise click.UsageError("--at and --last exclude each other")
    name = Path(case).name
    if name in ("", ".", ".."):
        raise click.UsageError(f"{case} is no case's name")
    target = folder or Path(name)
    try:
        stored = results_of(place, where, folders(volumes))
        opened = _open(stored, case, target, chosen)
    except (StorageError, BagRefusedError, ReplayError, MatrixError, bagpipe.BagError) as error:
        raise RefusedError(str(error)) from error
    except OSError as error:
        raise RefusedError(f"{target} can't be written: {error.strerror}") from error
    _show(opened, output)
    if serve:
        _serve(opened)


def _open(stored: StoredResults, case: str, folder: Path, chosen: dict[str, Any]) -> _Opened:
    stored.manifest()
    row = stored.row(case)
    if not row.get("window"):
        raise ReplayError(f"{case} has no window that could be shown: {row.get('message')}")
    start, end = int(row["window"][1]), int(row["window"][2])
    first = next(iter(moments(row)), None)
    begin = _begin(start, end, first, chosen["at"], chosen["last"])
    given = _given(stored, row, (begin, end), chosen["topics"])
    published = [Recording(data) for data in _published(stored, row)]
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{Path(case).name}.mcap"
    about = {"case": case, "results": stored.uri, "outcome": str(row["outcome"])}
    topics = write_view(file, given, published, notes(row, start), (begin, end), about)
    texts = {
        ".foxglove.json": foxglove(topics),
        ".plotjuggler.xml": plotjuggler(topics),
        ".rviz": rviz(topics, chosen["frame"]),
    }
    layouts = []
    for ending, text in texts.items():
        layouts.append(file.with_suffix(ending))
        layouts[-1].write_text(text)
    listed = [{"topic": each.name, "type": each.type, "messages": each.messages} for each in topics]
    count = sum(each.messages for each in topics)
    return _Opened(file, layouts, begin, end, first, count, listed)


def _begin(start: int, end: int, first: Moment | None, at: float | None, last: float | None) -> int:
    """Where the file begins, in ns."""
    if last is not None:
        return max(start, end - round(last * 1e9))
    if at is not None:
        begin = start + round(at * 1e9)
        if not start <= begin < end:
            length = (end - start) / 1e9
            raise ReplayError(f"--at {at:g} is not in the window, which lasts {length:g} s")
        return begin
    before = first.seconds - _BEFORE_SECONDS if first else 0.0
    return start + max(0, round(before * 1e9))


def _given(
    stored: StoredResults, row: Row, span: tuple[int, int], topics: tuple[str, ...]
) -> Recording | None:
    """What was recorded in that time: all of it, played or not. None where nothing was."""
    if row.get("parts"):
        return Recording(_joined(stored, row))
    kind, uri = kind_of(row["bag"], stored.storage)
    file: Any = BagFile(uri, stored.storage, _BUDGET)
    if kind != "bag":
        file = Elsewhere(uri, kind, stored.storage, _BUDGET)
    first = file.described()["start"] or 0
    made = file.part(max(0, span[0] - first), max(1, span[1] - first), topics, "none")
    return Recording(made.to_bytes() if kind == "bag" else made.data)


def _joined(stored: StoredResults, row: Row) -> bytes:
    """The input of a case that was put together."""
    spec = stored.spec()
    if spec is None:
        raise ReplayError(f"{stored.uri} has no job.json: the job was run by an older version")
    case = planned_case(row, local_spec(spec), stored.storage)
    with tempfile.TemporaryDirectory(prefix="bagpipe-") as folder:
        written = write_fragment(case, source_of(spec), stored.storage, Path(folder, "input"))
        return written.read_bytes()


def _published(stored: StoredResults, row: Row) -> Iterator[bytes]:
    recorded = row.get("recorded") or []
    for name in [recorded] if isinstance(recorded, str) else recorded:
        if re.search(r"\.(bag|mcap)$", name):
            uri = name if "://" in name else f"{stored.uri}/{name}"
            yield stored.storage.read_all(uri, _BUDGET)


def _show(opened: _Opened, output: str) -> None:
    if output != "table":
        print_as(
            {
                "file": str(opened.file),
                "layouts": [str(each) for each in opened.layouts],
                "start": opened.start,
                "end": opened.end,
                "moment": opened.moment and opened.moment.seconds,
                "messages": opened.messages,
                "topics": opened.topics,
            },
            output,
        )
        return
    seconds = (opened.end - opened.start) / 1e9
    click.echo(f"{opened.file}: {seconds:.3f} s, {opened.messages:,} messages")
    if opened.moment is not None:
        click.echo(f"at {opened.moment.seconds:.3f} s: {opened.moment.what}")
    for layout in opened.layouts:
        click.echo(f"layout: {layout}")


def _serve(opened: _Opened) -> None:
    with FileServer(opened.file) as server:
        click.echo(f"{server.url}  (Ctrl-C ends it)")
        click.echo(foxglove_link(server.url, opened.start))
        try:
            server.serve_forever(poll_interval=0.2)
        except KeyboardInterrupt:
            click.echo("")
