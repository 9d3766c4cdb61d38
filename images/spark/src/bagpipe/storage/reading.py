"""Ranges of a file, asked for in parallel, handed out in order, within a bound of memory."""

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

from bagpipe.storage.backend import Backend, Stat, TransientError
from bagpipe.storage.faults import StorageError, storage_errors
from bagpipe.storage.retries import Attempts, Clock, Patience

# Times `Backend.parallel`, 8 for remote storage: a reader holds at most 32 MiB.
REQUEST_BYTES = 4 << 20
_LINES_BYTES = 1 << 20

Range = tuple[int, int]


@dataclass(frozen=True)
class Request:
    """One ranged read, and the parts of its answer that were asked for, in order."""

    offset: int
    length: int
    parts: tuple[Range, ...]


def requests(ranges: list[Range], request_bytes: int, gap_bytes: int) -> Iterator[Request]:
    """The (offset, length) ranges as requests of at most `request_bytes`.

    Ranges that follow each other within `gap_bytes` share a request; longer ones are cut.
    """
    begin, end, parts = 0, 0, list[Range]()
    for at, length in _cut(ranges, request_bytes):
        near = 0 <= at - end <= gap_bytes and at + length - begin <= request_bytes
        if parts and not near:
            yield Request(begin, end - begin, tuple(parts))
            parts = []
        if not parts:
            begin = at
        end = at + length
        parts.append((at - begin, length))
    if parts:
        yield Request(begin, end - begin, tuple(parts))


def _cut(ranges: list[Range], request_bytes: int) -> Iterator[Range]:
    for offset, length in ranges:
        end = offset + length
        for at in range(offset, end, request_bytes):
            yield at, min(request_bytes, end - at)


@dataclass(frozen=True)
class OpenFile:
    """A file as it was when it was opened: reading it after a change is an error."""

    uri: str
    stat: Stat
    _backend: Backend
    _path: str
    _patience: Patience
    _clock: Clock

    @property
    def size(self) -> int:
        """Bytes."""
        return self.stat.size

    @property
    def version(self) -> str:
        """A mark that changes with the content."""
        return self.stat.version

    def read(self, offset: int, length: int) -> bytes:
        """`length` bytes from `offset`, fewer only at the file's end. Raises StorageError."""
        length = max(0, min(length, self.size - offset))
        return b"".join(self.pieces([(offset, length)], REQUEST_BYTES))

    def pieces(self, ranges: list[Range], piece_bytes: int) -> Iterator[bytes]:
        """The ranges in order, in pieces of at most `piece_bytes`. Raises StorageError."""
        for offset, length in ranges:
            if offset + length > self.size:
                raise StorageError(
                    f"{self.uri} ends at byte {self.size}, but its index names bytes up to"
                    f" {offset + length}: the file changed while the job ran"
                )
        local = self._backend.parallel == 1
        asked = requests(ranges, piece_bytes if local else REQUEST_BYTES, self._backend.gap_bytes)
        with storage_errors(self.uri, "read"):
            answers = self._in_turn(asked) if local else self._ahead(asked)
            for request, data in answers:
                for begin, length in request.parts:
                    for at in range(begin, begin + length, piece_bytes):
                        yield data[at : min(at + piece_bytes, begin + length)]

    def lines(self) -> Iterator[bytes]:
        """The file's lines without their ends, of which one piece is held at a time.

        Whitespace behind the last line's end is no line. Raises StorageError.
        """
        rest = b""
        for piece in self.pieces([(0, self.size)], _LINES_BYTES):
            *whole, rest = (rest + piece).split(b"\n")
            yield from whole
        if rest.strip():
            yield rest

    def _in_turn(self, asked: Iterator[Request]) -> Iterator[tuple[Request, bytes]]:
        for request in asked:
            yield request, self._fetch(request)

    def _ahead(self, asked: Iterator[Request]) -> Iterator[tuple[Request, bytes]]:
        """Answers in order; with the one in the reader's hands, `parallel` at a time exist."""
        waiting: deque[tuple[Request, Future[bytes]]] = deque()
        pool = ThreadPoolExecutor(self._backend.parallel, thread_name_prefix="storage-read")
        try:
            for request in asked:
                waiting.append((request, pool.submit(self._fetch, request)))
                if len(waiting) >= self._backend.parallel:
                    first, answer = waiting.popleft()
                    yield first, answer.result()
            while waiting:
                first, answer = waiting.popleft()
                yield first, answer.result()
        finally:
            # A reader that stops half-way must not wait for what it no longer wants.
            pool.shutdown(wait=False, cancel_futures=True)

    def _fetch(self, request: Request) -> bytes:
        """The whole answer to one request."""
        asked = request.offset, request.length
        return fetch(self._backend, self._path, asked, self.version, (self._patience, self._clock))


def fetch(
    backend: Backend, path: str, asked: Range, version: str, waiting: tuple[Patience, Clock]
) -> bytes:
    """One (offset, length) range, whole: a broken answer goes on at the byte where it broke.

    Raises OSError.
    """
    offset, length = asked
    attempts = Attempts(*waiting)
    data = bytearray()
    while len(data) < length:
        at = offset + len(data)
        wanted = length - len(data)
        try:
            more = backend.read(path, at, wanted, version)
            if not data and len(more) == wanted:
                return more
            data += more
            if len(more) < wanted:
                at += len(more)
                raise TransientError(f"the answer broke off {wanted - len(more)} bytes early")
        except TransientError as error:
            attempts.failed(error, f"at byte {at}: ")
    return bytes(data)
