"""What every SDK must do: run with the program `repeat` of each language."""

import os
import signal
from collections.abc import Callable, Sequence

import pytest

from bagpipe.binpiped.exchange import exchange
from bagpipe.binpiped.failure import BinPipedError
from bagpipe.binpiped.logic import Command, Deadlines
from bagpipe.binpiped.record import Field, InputRecord, OutputHead, Record

Check = Callable[[Command], None]
DEADLINES = Deadlines(partition=60, record=30)
LARGE = 5_000_000


def record(name: str, data: bytes = b"", **fields: Field) -> InputRecord:
    pieces = [data[at : at + 700_001] for at in range(0, len(data), 700_001)]
    return InputRecord(name, len(data), lambda: iter(pieces), fields)


def run(
    command: Command, records: Sequence[InputRecord], deadlines: Deadlines = DEADLINES
) -> list[Record]:
    found: list[tuple[OutputHead, list[bytes]]] = []
    for item in exchange(command, records, deadlines):
        if isinstance(item, OutputHead):
            found.append((item, []))
        else:
            found[-1][1].append(item)
    return [Record(head.name, head.fields, b"".join(data)) for head, data in found]


def no_one_and_many_outputs(command: Command) -> None:
    inputs = [record(f"r{n}", b"x" * n, copies=n) for n in (0, 1, 2, 30)]
    got = run(command, inputs)
    assert [r.name for r in got] == ["r1#0", "r2#0", "r2#1", *(f"r30#{n}" for n in range(30))]
    assert [len(r.data) for r in got] == [1, 2, 2] + [30] * 30


def large_records_come_back_whole(command: Command) -> None:
    data = os.urandom(LARGE)
    got = run(command, [record("a", data, copies=2), record("b", data[::-1])])
    assert [r.data == data for r in got] == [True, True, False]
    assert got[2].data == data[::-1]


def sizes_may_be_unknown(command: Command) -> None:
    data = os.urandom(LARGE)
    got = run(command, [record("a", data, copies=2, stream=1), record("b", b"", stream=1)])
    assert [r.name for r in got] == ["a#0", "a#1", "b#0"]
    assert [r.data for r in got] == [data, data, b""]


def empty_records_stay_records(command: Command) -> None:
    got = run(command, [record("a"), record("b")])
    assert [(r.name, r.data, r.fields) for r in got] == [
        ("a#0", b"", {"bytes_in": 0}),
        ("b#0", b"", {"bytes_in": 0}),
    ]


def no_records_are_no_fault(command: Command) -> None:
    assert run(command, []) == []


def names_and_fields_keep_their_types(command: Command) -> None:
    numbers = [0, 127, 128, 255, 256, 65_535, 65_536, 2**32 - 1, 2**32, 2**63 - 1]
    numbers += [-1, -32, -33, -128, -129, -32_769, -(2**31) - 1, -(2**63)]
    fields: dict[str, Field] = {f"n{at}": number for at, number in enumerate(numbers)}
    fields |= {"text": "Straße 車道 🚗", "none": "", "blob": bytes(range(256)), "empty": b""}
    fields |= {"long": "é" * 40_000, "big": os.urandom(70_000), "x" * 300: "long key"}
    (got,) = run(command, [record("/データ/bild ü.jpg", b"1", **fields)])
    assert got.name == "/データ/bild ü.jpg#0"
    assert got.fields == fields | {"bytes_in": 1}


def many_small_records(command: Command) -> None:
    inputs = (record(str(n), n.to_bytes(4, "little")) for n in range(5_000))
    got = run(command, list(inputs))
    assert [int.from_bytes(r.data, "little") for r in got] == list(range(5_000))


def an_early_exit_is_reported_with_its_status_and_last_lines(command: Command) -> None:
    with pytest.raises(BinPipedError, match=r"(?s)exit status 7.*leaving early") as failed:
        run(command, [record("a"), record("b", exit=7), record("c")])
    assert (failed.value.exit_status, failed.value.signal) == (7, None)
    assert failed.value.stderr[-1] == "leaving early"


def an_exit_of_zero_before_the_end_is_a_failure_too(command: Command) -> None:
    with pytest.raises(BinPipedError) as failed:
        run(command, [record("a"), record("b", exit=0), record("c")])
    assert (failed.value.reason, failed.value.exit_status) == ("ProgramEnded", 0)


def a_signal_is_reported_by_its_name(command: Command) -> None:
    with pytest.raises(BinPipedError, match="SIGABRT") as failed:
        run(command, [record("a", signal=int(signal.SIGABRT))])
    assert failed.value.signal == signal.SIGABRT


CHECKS: list[Check] = [
    no_one_and_many_outputs,
    large_records_come_back_whole,
    sizes_may_be_unknown,
    empty_records_stay_records,
    no_records_are_no_fault,
    names_and_fields_keep_their_types,
    many_small_records,
    an_early_exit_is_reported_with_its_status_and_last_lines,
    an_exit_of_zero_before_the_end_is_a_failure_too,
    a_signal_is_reported_by_its_name,
]
