"""A new object, sent in parts while it is written; it exists once the last part is confirmed."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

import obstore

from bagpipe.storage.backend import TransientError
from bagpipe.storage.object_faults import asked
from bagpipe.storage.retries import Clock, Patience, persistently

if TYPE_CHECKING:
    from obstore.store import ObjectStore

# S3 takes 10,000 parts of at least 5 MiB, and the library wants to know their size before it sends
# the first: an object has at most 83.8 GB. Larger parts would take more memory in every worker.
PART_BYTES, MOST_PARTS = 8 << 20, 10_000
# One part is sent while the next fills up: with one that waits, and one that the library
# collects, at most 32 MiB. Recordings grow more slowly than a part takes.
_AT_ONCE = 1


class AbandonedError(Exception):
    """The writer gave up, so the upload must be aborted."""


class Upload:
    """A small object is one put; a larger one is a multipart upload in a thread of its own."""

    def __init__(
        self, store: ObjectStore, uploads: ObjectStore, path: str, patience: Patience
    ) -> None:
        self._store = store
        self._uploads = uploads
        self._path = path
        self._patience = patience
        self._buffer = bytearray()
        # None ends the object, False abandons it.
        self._parts: queue.Queue[bytes | bool | None] = queue.Queue(maxsize=1)
        self._thread: threading.Thread | None = None
        self._error: OSError | None = None
        self._done = False
        self._sent_parts = 0

    def write(self, data: bytes) -> None:
        """Append. Raises OSError, also for a part that was sent earlier."""
        self._buffer += data
        while len(self._buffer) >= PART_BYTES:
            part = bytes(memoryview(self._buffer)[:PART_BYTES])
            del self._buffer[:PART_BYTES]
            self._send_part(part)

    def commit(self) -> None:
        """Send what is left and complete the object. Raises OSError."""
        if self._thread is None:
            persistently(self._put, self._patience, Clock())
        else:
            if self._buffer:
                self._send_part(bytes(self._buffer))
            self._send(None)
            self._thread.join(self._seconds())
            if self._thread.is_alive():
                raise TransientError("the upload did not end in time")
            if self._error is not None:
                raise self._error
        self._done = True

    def abandon(self) -> None:
        """Abort an upload that was not completed."""
        if self._done or self._thread is None:
            return
        # A thread that has failed takes no part any more, and needs no word to end.
        with contextlib.suppress(OSError):
            self._send(False)
        self._thread.join(self._seconds())
        self._done = True

    def _put(self) -> None:
        with asked():
            obstore.put(self._store, self._path, bytes(self._buffer), use_multipart=False)

    def _send_part(self, part: bytes) -> None:
        if self._sent_parts == MOST_PARTS:
            raise OSError(
                f"an object has at most {MOST_PARTS * PART_BYTES:,} bytes ({MOST_PARTS:,} parts):"
                " write smaller files, or to a volume or HDFS, which have no such bound"
            )
        self._send(part)
        self._sent_parts += 1

    def _send(self, part: bytes | bool | None) -> None:
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="storage-upload", daemon=True)
            self._thread.start()
        deadline = time.monotonic() + self._seconds()
        while True:
            if self._error is not None:
                raise self._error
            try:
                return self._parts.put(part, timeout=0.1)
            except queue.Full:
                if time.monotonic() > deadline:
                    raise TransientError("the server took no part of the upload in time") from None

    def _seconds(self) -> float:
        """The library gives up a part after this long."""
        return self._patience.request_seconds * self._patience.tries + 30.0

    def _run(self) -> None:
        try:
            with asked():
                obstore.put(
                    self._uploads,
                    self._path,
                    self._sent(),
                    use_multipart=True,
                    chunk_size=PART_BYTES,
                    max_concurrency=_AT_ONCE,
                )
        except TransientError as error:
            seconds = f"{self._seconds():.0f} s"
            self._error = TransientError(f"{error}, also when asked again for {seconds}")
        except OSError as error:
            self._error = error
        except BaseException as error:  # noqa: BLE001  a thread has nobody to raise to
            self._error = OSError(f"the upload failed ({type(error).__name__})")

    def _sent(self) -> Iterator[bytes]:
        # Waits as long as the writer takes, which ends every upload by commit or abandon.
        while (part := self._parts.get()) is not None:
            if isinstance(part, bool):
                # The library takes a further piece once the part before is confirmed. A part
                # that is still on its way could outlive the abort, and be kept for ever.
                yield b""
                raise AbandonedError
            yield part
