"""Requests, retries and read-ahead, with storage that fails as scripted and a fake clock."""

import threading
from collections.abc import Generator
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe.storage.backend import ChangedError, Stat, TransientError
from bagpipe.storage.faults import StorageError
from bagpipe.storage.local import LocalBackend
from bagpipe.storage.reading import REQUEST_BYTES, OpenFile, Request, requests
from bagpipe.storage.retries import Clock, Patience, persistently


@dataclass
class FakeTime:
    """Time that passes only by sleeping; every pause is noted, in seconds."""

    pauses: list[float] = field(default_factory=list)
    chance: float = 1.0

    def clock(self) -> Clock:
        return Clock(lambda: sum(self.pauses), self.pauses.append, lambda: self.chance)


class FakeBackend(LocalBackend):
    """A file in memory; `faults` are what its first answers are: an error, or a length."""

    parallel = 8
    gap_bytes = 100

    def __init__(self, data: bytes, *faults: OSError | int) -> None:
        self.data = data
        self.faults = list(faults)
        self.asked: list[tuple[int, int]] = []
        self._lock = threading.Lock()

    def read(self, path: str, offset: int, length: int, version: str) -> bytes:  # noqa: ARG002
        with self._lock:
            self.asked.append((offset, length))
            fault = self.faults.pop(0) if self.faults else length
        if isinstance(fault, OSError):
            raise fault
        return self.data[offset : offset + min(length, fault)]


def opened(backend: FakeBackend, time: FakeTime | None = None) -> OpenFile:
    stat = Stat(len(backend.data), "1")
    return OpenFile("s3://b/x", stat, backend, "x", Patience(), (time or FakeTime()).clock())


def test_pauses_double_up_to_a_bound_and_end() -> None:
    patience = Patience(tries=8, first_pause_seconds=0.5, longest_pause_seconds=20)
    assert [patience.pause_seconds(n, 1.0) for n in range(1, 9)] == [
        0.5, 1, 2, 4, 8, 16, 20, None,
    ]  # fmt: skip
    assert patience.pause_seconds(3, 0.0) == 1.0


def test_a_busy_server_is_asked_again_until_it_answers() -> None:
    answers: list[OSError | str] = [TransientError("503"), TransientError("503"), "yes"]
    time = FakeTime()

    def ask() -> str:
        answer = answers.pop(0)
        if isinstance(answer, OSError):
            raise answer
        return answer

    assert persistently(ask, Patience(), time.clock()) == "yes"
    assert time.pauses == [0.5, 1.0]


def test_the_last_try_reports_how_often_and_how_long() -> None:
    backend = FakeBackend(bytes(100), *[TransientError("the server answered 503")] * 8)
    time = FakeTime()
    with pytest.raises(StorageError) as error:
        opened(backend, time).read(20, 30)
    assert str(error.value) == (
        "s3://b/x can't be read: at byte 20: the server answered 503 (8 tries in 52 s): check that"
        " the storage is up and reachable from the job's pods, then run the job again"
    )
    assert (len(backend.asked), sum(time.pauses)) == (8, 51.5)


def test_a_refusal_is_not_repeated() -> None:
    backend = FakeBackend(bytes(100), OSError("the credential was refused"))
    time = FakeTime()
    with pytest.raises(StorageError, match=r"s3://b/x can't be read: the credential was refused"):
        opened(backend, time).read(0, 10)
    assert (len(backend.asked), time.pauses) == (1, [])


def test_a_broken_answer_goes_on_at_its_byte() -> None:
    data = bytes(range(256)) * 4
    backend = FakeBackend(data, 100, TransientError("the connection broke"), 1)
    assert opened(backend).read(10, 900) == data[10:910]
    assert backend.asked == [(10, 900), (110, 800), (110, 800), (111, 799)]


def test_an_answer_that_always_breaks_names_the_byte_it_reached() -> None:
    backend = FakeBackend(bytes(100), *[2] * 8)
    with pytest.raises(StorageError, match="at byte 16: the answer broke off 84 bytes early"):
        opened(backend).read(0, 100)


def test_a_changed_file_is_refused() -> None:
    with pytest.raises(StorageError, match="is no longer the file that was planned"):
        opened(FakeBackend(bytes(9), ChangedError())).read(0, 9)


def test_neighbours_share_a_request_and_long_ranges_are_cut() -> None:
    found = list(requests([(0, 10), (10, 5), (20, 5), (130, 1), (90, 250)], 100, 10))
    assert found == [
        Request(0, 25, ((0, 10), (10, 5), (20, 5))),
        Request(130, 1, ((0, 1),)),
        Request(90, 100, ((0, 100),)),
        Request(190, 100, ((0, 100),)),
        Request(290, 50, ((0, 50),)),
    ]


@given(
    st.lists(st.tuples(st.integers(0, 900), st.integers(0, 100)), max_size=8),
    st.integers(1, 64),
    st.integers(1, 64),
    st.integers(0, 64),
)
def test_pieces_are_the_bytes_of_the_ranges(
    ranges: list[tuple[int, int]], piece: int, request: int, gap: int
) -> None:
    data = bytes(n % 251 for n in range(1000))
    expected = b"".join(data[at : at + length] for at, length in ranges)
    pieces = list(opened(FakeBackend(data)).pieces(ranges, piece))
    assert b"".join(pieces) == expected
    assert all(0 < len(one) <= piece for one in pieces)
    cut = [(r.offset + at, n) for r in requests(ranges, request, gap) for at, n in r.parts]
    assert b"".join(data[at : at + length] for at, length in cut) == expected
    assert all(r.length <= request for r in requests(ranges, request, gap))


class SlowReader(FakeBackend):
    """Counts how many answers exist at once that the reader has not let go of."""

    def __init__(self, count: int) -> None:
        super().__init__(bytes(count * REQUEST_BYTES))
        self.taken = 0
        self.most = 0

    def read(self, path: str, offset: int, length: int, version: str) -> bytes:
        data = super().read(path, offset, length, version)
        with self._lock:
            self.most = max(self.most, len(self.asked) - self.taken)
        return data


def test_read_ahead_is_bounded_and_in_order() -> None:
    backend = SlowReader(40)
    for _piece in opened(backend).pieces([(0, 40 * REQUEST_BYTES)], REQUEST_BYTES):
        # The one before this is no longer the reader's.
        with backend._lock:
            assert len(backend.asked) - backend.taken <= 8
            backend.taken += 1
    assert backend.most <= 8
    assert sorted(backend.asked) == [(n * REQUEST_BYTES, REQUEST_BYTES) for n in range(40)]


def test_a_reader_that_stops_asks_for_no_more() -> None:
    backend = FakeBackend(bytes(40 * REQUEST_BYTES))
    pieces = opened(backend).pieces([(0, 40 * REQUEST_BYTES)], REQUEST_BYTES)
    next(pieces)
    assert isinstance(pieces, Generator)
    pieces.close()
    assert len(backend.asked) <= 8


@pytest.mark.parametrize(
    ("data", "lines"),
    [
        (b"", []),
        (b"one\ntwo\n", [b"one", b"two"]),
        (b"one\ntwo", [b"one", b"two"]),
        (b"one\n \r\n\t ", [b"one", b" \r"]),
        (b"one\n\ntwo\n\n", [b"one", b"", b"two", b""]),
    ],
)
def test_lines_end_with_the_last_that_says_anything(data: bytes, lines: list[bytes]) -> None:
    assert list(opened(FakeBackend(data)).lines()) == lines


def test_a_line_that_lies_in_two_pieces_is_one() -> None:
    data = b"a" * (1 << 20) + b"bc\nd\n"
    assert [len(line) for line in opened(FakeBackend(data)).lines()] == [(1 << 20) + 2, 1]
