"""`bagpipe open`: one case as a recording that viewers show, with layouts for them."""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

import bagpipe
from bagpipe.cli.bag_here import Written, recording_at
from bagpipe.cli.bag_reading import BagRefusedError
from bagpipe.cli.cluster.place import Place, place_options, results_option
from bagpipe.cli.cluster.results_of import results_of
from bagpipe.cli.places import (
    RefusedError,
    folders,
    output_option,
    print_as,
    uri_of,
    volume_option,
)
from bagpipe.cli.terminal import plain
from bagpipe.matrix.faults import MatrixError
from bagpipe.moments import Moment, moments
from bagpipe.report.stored import Row, StoredResults
from bagpipe.row_facts import recorded_names
from bagpipe.run.laptop import ReplayError, local_spec, planned_case, write_fragment
from bagpipe.source.chosen import source_of
from bagpipe.storage import StorageError
from bagpipe.topic_names import resolve
from bagpipe.view.course import Note, notes, time_at
from bagpipe.view.layouts import foxglove, plotjuggler, rviz
from bagpipe.view.recording import Recording, write_view
from bagpipe.view.server import FileServer, foxglove_link
from bagpipe.wire.session import SessionError

_BUDGET = 4 << 30
# What is shown before the moment at which something went wrong.
_BEFORE_SECONDS = 2.0
_MOST_SECONDS = 1e9
_MOST_TIME = (1 << 63) - 1


@dataclass(frozen=True)
class _Opened:
    file: Path
    layouts: list[Path]
    start: int
    end: int
    moment: Moment | None
    messages: int
    topics: list[dict[str, Any]]
    damaged: list[str]


@dataclass(frozen=True)
class _Line:
    """What a row says: the case's window in ns, what was found in it, and the files of it."""

    start: int
    end: int
    moments: list[Moment]
    notes: list[Note]
    bag: str
    recorded: list[str]

    @property
    def latest(self) -> int:
        """Where a file of it all ends, in ns: behind the window where an answer came later."""
        return max([self.end, *(time_at(self.start, each.seconds) + 1 for each in self.moments)])


@click.command("open")
@click.argument("case", metavar="CASE")
@results_option
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
    of the same name, the recorded one is below /recorded. Courses of criteria are below
    /bagpipe/criteria, with their bounds. Layouts for Foxglove, PlotJuggler and RViz lie beside it.

    The exit status is 0 if the file was written, and 2 if not.

    \b
    bagpipe open night-0004-s2-pr-812 --results job/nightly -n robots
    bagpipe open night-0004 --results ./results --volume recordings=/data --last 10
    bagpipe open night-0004 --results ./results --volume recordings=/data --serve
    """
    _check_times(chosen["at"], chosen["last"])
    name = Path(case).name
    if name in ("", ".", ".."):
        raise click.UsageError(f"{case} is no case's name")
    target = folder or Path(name)
    try:
        stored = results_of(place, where, folders(volumes))
        opened = _open(stored, case, target, chosen)
    except (StorageError, BagRefusedError, ReplayError, MatrixError, SessionError) as error:
        raise RefusedError(plain(str(error))) from error
    except bagpipe.BagError as error:
        raise RefusedError(f"a recording of {plain(case)}: {plain(str(error))}") from error
    except OSError as error:
        raise RefusedError(f"{target} can't be written: {error.strerror}") from error
    _show(opened, output)
    if serve:
        _serve(opened, to_stderr=output != "table")


def _check_times(at: float | None, last: float | None) -> None:
    if at is not None and last is not None:
        raise click.UsageError("--at and --last exclude each other")
    for option, seconds in (("--at", at), ("--last", last)):
        if seconds is not None and not abs(seconds) < _MOST_SECONDS:
            raise click.UsageError(f"{option} {seconds:g}: write a number of seconds")
    if last is not None and last <= 0:
        raise click.UsageError(f"--last {last:g}: write how many seconds, more than 0")


def _open(stored: StoredResults, case: str, folder: Path, chosen: dict[str, Any]) -> _Opened:
    stored.manifest()
    row = stored.row(case)
    line = _line(stored, row)
    first = next(iter(line.moments), None)
    begin = _begin(line.start, line.end, first, chosen["at"], chosen["last"])
    end = line.end if chosen["last"] is not None else line.latest
    topics = tuple(resolve(topic) for topic in chosen["topics"])
    given = _given(stored, row, (begin, end), topics)
    published = {name: Recording(data) for name, data in _published(stored, line)}
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{Path(case).name}.mcap"
    about = {"case": case, "results": stored.uri, "outcome": str(row["outcome"])}
    written = write_view(file, given, published.values(), line.notes, (begin, end), about)
    texts = {
        ".foxglove.json": foxglove(written),
        ".plotjuggler.xml": plotjuggler(written),
        ".rviz": rviz(written, chosen["frame"]),
    }
    layouts = []
    for ending, text in texts.items():
        layouts.append(file.with_suffix(ending))
        layouts[-1].write_text(text)
    listed = [
        {"topic": each.name, "type": each.type, "messages": each.messages} for each in written
    ]
    count = sum(each.messages for each in written)
    damaged = [f"{name}: expected {each.damage}" for name, each in published.items() if each.damage]
    return _Opened(file, layouts, begin, end, first, count, listed, damaged)


def _line(stored: StoredResults, row: Row) -> _Line:
    case = row["case"]
    if not row.get("window"):
        raise ReplayError(f"{case} has no window that could be shown: {row.get('message')}")
    try:
        _, start, end = map(int, row["window"])
        recorded = recorded_names(row)
        if not all(isinstance(each, str) for each in (row["bag"], *recorded)):
            raise TypeError("its files have no names")
        when = moments(row)
        noted = list(notes(row, when, start))
        found = _Line(start, end, when, noted, row["bag"], recorded)
        if start < 0 or found.latest > _MOST_TIME:
            raise ValueError("its times are none of a recording")
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise ReplayError(
            f"{stored.uri}/results.jsonl has a line of {case} that is no row of results: {error!r}"
        ) from error
    if start >= end:
        raise ReplayError(
            f"{case} has no window that could be shown: it was given a file as it is, {found.bag}"
        )
    return found


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
    if "://" not in row["bag"]:
        return _joined(stored, row, topics) if row.get("parts") else None
    file = recording_at(uri_of(row["bag"], stored.storage.volumes), stored.storage, _BUDGET)
    first, last = file.times()
    begin = min(max(0, span[0] - first), last - first)
    made = file.part(begin, max(1, span[1] - first), topics, "none")
    return Recording(made.data if isinstance(made, Written) else made.to_bytes())


def _joined(stored: StoredResults, row: Row, topics: tuple[str, ...]) -> Recording | None:
    """The input of a case that was put together; None beside a simulator, which made it then."""
    spec = stored.spec()
    if spec is None:
        raise ReplayError(f"{stored.uri} has no job.json: the job was run by an older version")
    if source_of(spec).alone(row["bag"]) is None:
        return None
    case = planned_case(row, local_spec(spec), stored.storage)
    with tempfile.TemporaryDirectory(prefix="bagpipe-") as folder:
        written = write_fragment(case, source_of(spec), stored.storage, Path(folder, "input"))
        made = Recording(written.read_bytes(), topics)
    for topic in topics:
        if topic not in made.topics:
            have = ", ".join(sorted(made.topics)[:10])
            raise ReplayError(f"{row['case']} has no topic {topic}; it has {have}")
    return made


def _published(stored: StoredResults, line: _Line) -> Iterator[tuple[str, bytes]]:
    left = _BUDGET
    for name in line.recorded:
        if not name.endswith((".bag", ".mcap")):
            continue
        # Of a resumed job they are URIs of the earlier one's.
        own = "://" not in name
        if own and (name.startswith("/") or ".." in name.split("/")):
            raise ReplayError(f"{name} is no name below {stored.uri}")
        uri = f"{stored.uri}/{name}" if own else uri_of(name, stored.storage.volumes)
        data = stored.storage.read_all(uri, left)
        left -= len(data)
        yield name, data


def _show(opened: _Opened, output: str) -> None:
    for damaged in opened.damaged:
        click.echo(f"note: {plain(damaged)}: what is whole is shown", err=True)
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
    click.echo(f"{plain(str(opened.file))}: {seconds:.3f} s, {opened.messages:,} messages")
    if opened.moment is not None:
        click.echo(f"at {opened.moment.seconds:.3f} s: {plain(opened.moment.what)}")
    for layout in opened.layouts:
        click.echo(f"layout: {plain(str(layout))}")


def _serve(opened: _Opened, *, to_stderr: bool) -> None:
    with FileServer(opened.file) as server:
        click.echo(f"{server.url}  (Ctrl-C ends it)", err=to_stderr)
        click.echo(foxglove_link(server.url, opened.start), err=to_stderr)
        try:
            server.serve_forever(poll_interval=0.2)
        except KeyboardInterrupt:
            click.echo("", err=to_stderr)
