"""`bagpipe bag`: look into recordings, cut, join, check, mend and convert them."""

import contextlib
import re
from collections.abc import Callable, Iterator
from decimal import Decimal
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from bagpipe.cli.bag_for_ros1 import for_ros1
from bagpipe.cli.bag_for_ros2 import for_ros2
from bagpipe.cli.bag_here import Elsewhere, Written, kind_of, merged, recording_at
from bagpipe.cli.bag_reading import BagFile, BagRefusedError, damage_data, damage_of, naming, native
from bagpipe.cli.places import (
    RefusedError,
    folders,
    output_option,
    print_as,
    uri_of,
    volume_option,
)
from bagpipe.cli.terminal import unstyled
from bagpipe.plan.bag_tail import BagError, read_tail
from bagpipe.storage import Storage, StorageError

_PIECE_BYTES = 1 << 20
# By what --messages says; without it they stay as they are.
_CONVERTED = {"ros1": for_ros1, "ros2": for_ros2}
_UNITS = {"": 1, "B": 1, "KiB": 1 << 10, "MiB": 1 << 20, "GiB": 1 << 30}


class _Size(click.ParamType[int]):
    """Bytes, or a number with KiB, MiB or GiB, as bagpipe-agent has it."""

    name = "size"

    def convert(self, value: Any, _param: Any, _ctx: Any) -> int:
        found = re.fullmatch(r"(\d+)\s*([A-Za-z]*)", str(value))
        if found is None or found[2] not in _UNITS:
            self.fail(f"{value}: write bytes, or a number with KiB, MiB or GiB")
        return int(found[1]) * _UNITS[found[2]]


class _Seconds(click.ParamType[int]):
    """Seconds with at most nine decimals, as exact ns."""

    name = "seconds"

    def convert(self, value: Any, _param: Any, _ctx: Any) -> int:
        if isinstance(value, int):
            return value
        if not re.fullmatch(r"\d+(\.\d{1,9})?", str(value)):
            self.fail(f"{value} is no number of seconds such as 12 or 12.5")
        return int(Decimal(value) * 1_000_000_000)


_budget_option = click.option(
    "--memory-budget",
    "budget",
    type=_Size(),
    metavar="SIZE",
    default="4GiB",
    show_default=True,
    help="The most memory of what is read of a bag, and as much of what it holds compressed.",
)
_target_option = click.option(
    "--to",
    "target",
    required=True,
    metavar="BAG",
    help="The new bag's path or URI. A bag that is there is never overwritten.",
)
_compression_option = click.option(
    "--compression",
    type=click.Choice(["none", "lz4", "bz2", "zstd"]),
    default="none",
    show_default=True,
    help="Of chunks that are rewritten (a bag: none, lz4 or bz2; MCAP: none, lz4 or zstd); a bag's"
    " whole chunks stay as they are.",
)


@click.group("bag")
def bag_group() -> None:
    """Look into recordings, cut, join, check, mend and convert them.

    BAG is a bag of ROS 1, an MCAP file, or a folder of rosbag2 (of MCAP or SQLite): a path of this
    machine, or a URI as in a manifest: pvc:// (with --volume), s3://, hdfs://, gs://, az:// or
    https://. What is made of a bag is a bag; what is made of all else is MCAP.
    """


@bag_group.command("info")
@click.argument("bag", metavar="BAG")
@volume_option
@_budget_option
@output_option
def info_command(bag: str, volumes: tuple[str, ...], budget: int, output: str) -> None:
    """Show what is in BAG: times, topics, types, counts, and damage.

    Of a bag or MCAP with an index only its tail is read, however large it is and wherever it lies;
    a folder of rosbag2, and what has no index, is read whole. The exit status is 0 if it can be
    read, also where a part of it is lost, and 2 if not.

    \b
    bagpipe bag info drive.bag
    bagpipe bag info s3://fleet/2026-11/drive.bag --output json | jq '.topics[].topic'
    """
    found = _done(lambda: _opened(bag, volumes, budget).described())
    _print(found, output, _show_info)


@bag_group.command("slice")
@click.argument("bag", metavar="BAG")
@_target_option
@click.option("--start", type=_Seconds(), default=0, help="Where it starts.  [default: 0]")
@click.option("--end", type=_Seconds(), help="Where it ends; without it, behind the last message.")
@click.option("--topic", "topics", multiple=True, metavar="NAME", help="Only it. May be repeated.")
@_compression_option
@volume_option
@_budget_option
@output_option
def slice_command(bag: str, target: str, output: str, **given: Any) -> None:
    """Write a part of BAG, by time and topic, as a bag of its own.

    Times are seconds after its first message; messages with start <= t < end are taken. A latched
    message from before (/tf_static, a map) goes with it, at its start. Of a bag with an index only
    the chunks that are needed are read. The exit status is 2 if BAG is damaged or can't be read.

    \b
    bagpipe bag slice drive.bag --start 60 --end 80 --topic /imu --to part.bag
    bagpipe bag slice s3://fleet/drive.bag --start 60 --end 80 --to part.bag
    """

    def done() -> dict[str, Any]:
        end, start = given["end"], given["start"]
        if end is not None and end <= start:
            raise BagRefusedError("--start must lie before --end")
        file = _opened(bag, given["volumes"], given["budget"])
        uri = _new(target, file.storage)
        made: Any = file.part(start, end, given["topics"], given["compression"])
        return _written(made, target, uri, file.storage)

    _print(_done(done), output, _show_written)


@bag_group.command("merge")
@click.argument("bags", metavar="BAG...", nargs=-1, required=True)
@_target_option
@_compression_option
@volume_option
@_budget_option
@output_option
def merge_command(bags: tuple[str, ...], target: str, output: str, **given: Any) -> None:
    """Write several bags as one.

    Messages are ordered by time; those of the same time keep the order of the command line. A
    message that two bags hold comes twice. All of them lie in memory at once. The exit status is
    2 if one is damaged or can't be read.

    \b
    bagpipe bag merge front.bag rear.bag --to drive.bag
    """

    def done() -> dict[str, Any]:
        files = [_opened(bag, given["volumes"], given["budget"]) for bag in bags]
        uri = _new(target, files[0].storage)
        of_ros1 = [file for file in files if isinstance(file, BagFile)]
        others = [file for file in files if isinstance(file, Elsewhere)]
        if of_ros1 and others:
            raise BagRefusedError(
                f"{of_ros1[0].uri} is a bag and {others[0].uri} is none: `bagpipe bag convert`"
                " makes them alike first"
            )
        if others:
            return _written(merged(others, given["compression"]), target, uri, files[0].storage)
        read = [file.whole() for file in of_ros1]
        with naming(target):
            made = native().merge(read, compression=given["compression"])
        return _written(made, target, uri, files[0].storage)

    _print(_done(done), output, _show_written)


@bag_group.command("check")
@click.argument("bags", metavar="BAG...", nargs=-1, required=True)
@volume_option
@_budget_option
@output_option
def check_command(
    bags: tuple[str, ...], volumes: tuple[str, ...], budget: int, output: str
) -> None:
    """Read every record of each BAG and say whether it is whole.

    Every chunk is uncompressed and compared with the index; of MCAP, with the times of its message
    indexes, too. The exit status is 0 if nothing is lost and nothing contradicts itself, 1 if
    something is or does, and 2 if a bag can't be read.

    \b
    bagpipe bag check recordings/*.bag
    """
    found = [_checked(bag, volumes, budget) for bag in bags]
    _print(found, output, _show_checked)
    states = {each["state"] for each in found}
    raise SystemExit(2 if "unreadable" in states else 1 if "damaged" in states else 0)


@bag_group.command("reindex")
@click.argument("bag", metavar="BAG")
@_target_option
@_compression_option
@volume_option
@_budget_option
@output_option
def reindex_command(bag: str, target: str, output: str, **given: Any) -> None:
    """Save what is whole of BAG, with an index.

    For a recording whose recorder died, a file that was cut off, or one that `check` complains
    about. Every whole message before the damage is kept; of a chunk whose checksum is wrong, none.
    BAG is not changed. The exit status is 0 also where something is lost, which is in the output,
    and 2 if nothing of it can be read.

    \b
    bagpipe bag reindex drive.bag.active --to drive.bag
    bagpipe bag reindex s3://fleet/cut.mcap --to whole.mcap --compression lz4
    """

    def done() -> dict[str, Any]:
        file = _elsewhere(bag, given["volumes"], given["budget"])
        uri = _new(target, file.storage)
        return _written(file.mended(given["compression"]), target, uri, file.storage)

    _print(_done(done), output, _show_written)


@bag_group.command("convert")
@click.argument("bag", metavar="BAG")
@_target_option
@click.option(
    "--messages",
    type=click.Choice(["as-they-are", "ros1", "ros2"]),
    default="as-they-are",
    show_default=True,
    help="With ros2 those of ROS 1 become messages of ROS 2 (CDR), and with ros1 the other way"
    " round, by the recorded definitions.",
)
@_compression_option
@volume_option
@_budget_option
@output_option
def convert_command(bag: str, target: str, output: str, **given: Any) -> None:
    """Write BAG in another format, or compressed in another way.

    The new name ends in .bag or .mcap. Messages stay as they are, unless --messages is given: a bag
    takes those of ROS 1 alone, and MCAP takes all. The exit status is 2 if BAG is damaged,
    can't be read, or can't be that.

    \b
    bagpipe bag convert rosbag2_2026_11_23/ --to drive.mcap --compression zstd
    bagpipe bag convert drive.bag --to drive.mcap
    bagpipe bag convert drive.bag --to drive.mcap --messages ros2    # for a stack of ROS 2
    bagpipe bag convert drive.mcap --to drive.bag --messages ros1    # and for one of ROS 1
    """

    def done() -> dict[str, Any]:
        file = _elsewhere(bag, given["volumes"], given["budget"])
        uri = _new(target, file.storage)
        convert = _CONVERTED.get(given["messages"], Elsewhere.converted)
        return _written(convert(file, target, given["compression"]), target, uri, file.storage)

    _print(_done(done), output, _show_written)


def _elsewhere(where: str, volumes: tuple[str, ...], budget: int) -> Elsewhere:
    here = folders(volumes)
    storage = Storage(here)
    kind, uri = kind_of(uri_of(where, here), storage)[:2]
    return Elsewhere(uri, kind, storage, budget)


def _opened(where: str, volumes: tuple[str, ...], budget: int) -> BagFile | Elsewhere:
    here = folders(volumes)
    return recording_at(uri_of(where, here), Storage(here), budget)


def _done(work: Callable[[], Any]) -> Any:
    try:
        return work()
    except (BagRefusedError, StorageError) as error:
        raise RefusedError(str(error)) from error


def _checked(where: str, volumes: tuple[str, ...], budget: int) -> dict[str, Any]:
    try:
        file = _opened(where, volumes, budget)
        if isinstance(file, Elsewhere):
            return _checked_elsewhere(where, file)
        described = file.described()
        bag = file.whole()
        with naming(file.uri):
            found = bag.check()
    except (BagRefusedError, StorageError) as error:
        return {"bag": where, "state": "unreadable", "messages": None, "problems": [str(error)]}
    lost = damage_of(bag)
    problems = [_lost(lost)] if lost else []
    problems += found.problems
    if described["index"] not in {"whole", "none"}:
        problems.append(f"its index is {described['index']}: {described['advice']}")
    state = "sound" if found.sound and not problems else "damaged"
    return {"bag": where, "state": state, "messages": found.messages, "problems": problems}


def _checked_elsewhere(where: str, file: Elsewhere) -> dict[str, Any]:
    found = file.checked()
    lost = damage_data(found.damage)
    problems = ([_lost(lost)] if lost else []) + found.problems
    state = "sound" if found.sound else "damaged"
    return {"bag": where, "state": state, "messages": found.messages, "problems": problems}


def _new(target: str, storage: Storage) -> str:
    """The URI of a bag that is not there yet, known before anything is read for it."""
    uri = uri_of(target, storage.volumes)
    if storage.exists(uri):
        raise BagRefusedError(f"{target} is there already: choose another name")
    return uri


def _written(made: Any, target: str, uri: str, storage: Storage) -> dict[str, Any]:
    view = memoryview(made.data) if isinstance(made, Written) else made.view()
    with storage.create(uri) as file:
        for first in range(0, len(view), _PIECE_BYTES):
            file.write(bytes(view[first : first + _PIECE_BYTES]))
    if isinstance(made, Written):
        return {"bag": target, "bytes": len(view)} | _of_written(made)
    return {
        "bag": target,
        "bytes": len(view),
        "messages": made.message_count,
        "chunks": made.chunk_count,
        "start": made.start,
        "end": made.end,
    }


def _of_written(made: Written) -> dict[str, Any]:
    data = made.data
    chunks = []
    # What has no message has no index that could be planned.
    with contextlib.suppress(BagError):
        chunks = read_tail(lambda at, length: data[at : at + length], len(data)).chunks
    return {
        "messages": made.messages,
        "chunks": len(chunks),
        "start": min((chunk.start_time for chunk in chunks), default=None),
        "end": max((chunk.end_time for chunk in chunks), default=None),
        "damage": made.damage,
    } | ({"added": list(made.added)} if made.added else {})


def _print(found: Any, output: str, show: Callable[[Any, Console], None]) -> None:
    if output == "table":
        show(found, Console(emoji=False))
    else:
        print_as(found, output)


def _show_info(found: dict[str, Any], console: Console) -> None:
    for name, value in _lines(found):
        console.print(f"{name:<12}{unstyled(value)}", highlight=False, soft_wrap=True)
    console.print()
    table = Table(box=None, header_style="bold")
    table.add_column("Topic", overflow="fold")
    table.add_column("Messages", justify="right")
    table.add_column("Type", overflow="fold")
    for row in found["topics"]:
        table.add_row(unstyled(row["topic"]), f"{row['messages']:,}", unstyled(row["type"]))
    console.print(table)


def _lines(found: dict[str, Any]) -> Iterator[tuple[str, str]]:
    yield "bag", found["bag"]
    yield "size", f"{found['bytes']:,} bytes in {found['chunks']:,} chunks"
    if found["seconds"] is not None:
        yield "time", f"{_time(found['start'])} to {_time(found['end'])}"
        yield "duration", f"{found['seconds']:.9f} s"
    unknown = "not looked at: it has many chunks, and each stands at its own place"
    yield (
        "compressed",
        unknown if found["compressions"] is None else ", ".join(found["compressions"]),
    )
    yield "messages", f"{found['messages']:,}"
    if found["damage"]:
        yield "damaged", _lost(found["damage"])
    if found["advice"]:
        yield "index", f"{found['index']}: {found['advice']}"


def _time(nanoseconds: int) -> str:
    return f"{nanoseconds // 1_000_000_000}.{nanoseconds % 1_000_000_000:09d}"


def _lost(damage: dict[str, Any]) -> str:
    count = damage["messages"]
    messages = "an unknown number of messages" if count is None else f"{count} messages"
    return (
        f"at byte {damage['offset']}: expected {damage['description']}; {damage['bytes']} bytes and"
        f" {messages} are lost"
    )


def _show_written(found: dict[str, Any], console: Console) -> None:
    lines = [f"{found['bag']}: {found['messages']:,} messages, {found['bytes']:,} bytes"]
    if found.get("damage"):
        lines.append(f"lost of the old one: {_lost(found['damage'])}")
    if found.get("added"):
        ros = "ROS 1" if found["bag"].endswith(".bag") else "ROS 2"
        lines.append(f"fields that {ros} alone has are 0 or empty: {', '.join(found['added'])}")
    for text in lines:
        console.print(unstyled(text), highlight=False, soft_wrap=True)


def _show_checked(found: list[dict[str, Any]], console: Console) -> None:
    colours = {"sound": "green", "damaged": "red", "unreadable": "magenta"}
    for each in found:
        state = each["state"]
        count = "" if each["messages"] is None else f", {each['messages']:,} whole messages"
        console.print(
            f"[{colours[state]}]{state}[/]  {unstyled(each['bag'])}{count}",
            highlight=False,
            soft_wrap=True,
        )
        for problem in each["problems"]:
            console.print(f"  {unstyled(problem)}", highlight=False, soft_wrap=True)
