"""stdin and stdout of a program in a pod, over the websocket of `pods/exec`, byte for byte.

The client's own `WSClient.update` is not used: it takes in all that has come before it returns,
which of a fast stream is everything.
"""

import json
import time
from typing import Any

from websocket import ABNF, WebSocket, WebSocketException

from bagpipe.cli.pulling.entry import PullError
from bagpipe.cli.terminal import plain

_STDIN, _STDOUT, _STDERR, _STATUS = range(4)
_SEND_BYTES = 32 << 10
_MOST_WORDS = 4 << 10
_MOST_STATUS = 64 << 10


class ExecStream:
    """A connection that is open. Every method raises PullError, with what the program wrote."""

    def __init__(self, socket: WebSocket, silent_seconds: float, until: float) -> None:
        """`until` is a moment of time.monotonic(); nothing is waited for longer than both allow."""
        self._socket = socket
        self._silent_seconds = silent_seconds
        self._until = until
        self._rest = b""
        self._words = b""
        self._status = b""
        self._open = True

    def write(self, data: bytes) -> None:
        """To the program's stdin."""
        for at in range(0, len(data), _SEND_BYTES):
            piece = bytes([_STDIN]) + data[at : at + _SEND_BYTES]
            try:
                self._wait_at_most()
                self._socket.send(piece, ABNF.OPCODE_BINARY)
            except (WebSocketException, OSError) as error:
                raise PullError(self._broken(error)) from error

    def exactly(self, count: int) -> bytes:
        """The next `count` bytes of stdout."""
        kept = bytearray()
        while len(kept) < count:
            kept += self.some(count - len(kept))
        return bytes(kept)

    def some(self, most: int) -> bytes:
        """At least one and at most `most` of the next bytes."""
        while not self._rest:
            if not self._open:
                raise PullError(self._broken(None))
            self._take()
        piece, self._rest = self._rest[:most], self._rest[most:]
        return piece

    def end(self) -> None:
        """Waits for the program's end, which must be a good one, with nothing more written."""
        while self._open:
            self._take()
            if self._rest:
                raise PullError("the pod sent more than was asked for")
        if self._reported().get("status") != "Success":
            raise PullError(self._broken(None))

    def close(self) -> None:
        """Ends the connection, and the program with it; and waits for no answer."""
        self._socket.settimeout(1.0)
        self._socket.shutdown()  # type: ignore[no-untyped-call]

    def _take(self) -> None:
        """One frame more."""
        try:
            self._wait_at_most()
            code, frame = self._socket.recv_data_frame(control_frame=True)
        except (WebSocketException, OSError) as error:
            raise PullError(self._broken(error)) from error
        if code == ABNF.OPCODE_CLOSE:
            self._open = False
        elif code in (ABNF.OPCODE_BINARY, ABNF.OPCODE_TEXT) and frame.data:
            channel, data = frame.data[0], frame.data[1:]
            if channel == _STDOUT:
                self._rest += data
            elif channel == _STDERR:
                self._words = (self._words + data)[-_MOST_WORDS:]
            elif channel == _STATUS:
                self._status = (self._status + data)[:_MOST_STATUS]
                # The program has ended and all that it wrote has come: the server closes next.
                self._open = False

    def _wait_at_most(self) -> None:
        left = self._until - time.monotonic()
        if left <= 0:
            raise TimeoutError("the time that --timeout allows is over")
        self._socket.settimeout(min(self._silent_seconds, left))

    def _reported(self) -> dict[str, Any]:
        try:
            found = json.loads(self._status)
        except (ValueError, RecursionError):
            return {}
        return found if isinstance(found, dict) else {}

    def _broken(self, error: Exception | None) -> str:
        """Why there are no more bytes: the program's own words before those of what started it."""
        words = plain(self._words.decode(errors="replace").strip())
        reported = plain(str(self._reported().get("message") or ""))
        if words or reported:
            return f"the pod can't send the results: {words or reported}"
        why = f": {plain(str(error))}" if error is not None and str(error) else ""
        return f"the connection to the pod broke{why}; pull again, and it goes on where it stopped"
