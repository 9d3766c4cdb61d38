"""kopf's connection to the API server, reading lists and watches to a bound.

kopf parses answers by Python's json, which raises RecursionError for an object that anybody may
have nested, and ends with it; and it parses them whole, which takes ten times their size.
"""

from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from typing import Any

import aiohttp
import kopf

from bagpipe_operator.api.nesting import cut
from bagpipe_operator.cluster.large_objects import TRIMMED_FROM, read_answer, read_event

# Brackets below each other that json reads with room to spare for its callers.
_HARMLESS = 400

Answer = aiohttp.TraceRequestEndParams
Answered = Callable[[Answer], None]


class BoundedResponse(aiohttp.ClientResponse):
    """An answer whose JSON is read to a bound, in one piece and line by line."""

    async def start(self, connection: Any) -> aiohttp.ClientResponse:
        """Begins to read, through the bound where the answer is a watch."""
        await super().start(connection)
        if "watch" in self.url.query:
            self.content = BoundedLines(self.content)  # type: ignore[assignment]
        return self

    async def json(self, **_: Any) -> Any:
        """The answer's value."""
        return await read_answer(await self.read())


class BoundedLines:
    """A stream of lines, each of them JSON; all else is the stream's own."""

    def __init__(self, stream: aiohttp.StreamReader) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    async def iter_chunked(self, size: int) -> AsyncIterator[bytes]:
        """Whole lines, several at once maybe, none deeper than the bound; then what is left."""
        begun: list[bytes] = []
        async for chunk in self._stream.iter_chunked(size):
            *ended, rest = chunk.split(b"\n")
            if ended:
                lines = [b"".join([*begun, ended[0]]), *ended[1:]]
                yield b"".join([await _harmless(line) + b"\n" for line in lines])
                begun = []
            begun.append(rest)
        yield await _harmless(b"".join(begun))


async def _harmless(line: bytes) -> bytes:
    if len(line) > TRIMMED_FROM:
        return await read_event(line)
    few = line.count(b"[") + line.count(b"{") < _HARMLESS
    return line if few else cut(line)


@dataclass(frozen=True, kw_only=True)
class BoundedConnection(kopf.AiohttpSession):
    """A connection of ours; two are the same if what they were made from is.

    By that kopf knows a login that was refused before, and does not try it without end.
    """

    made_from: kopf.ConnectionInfo
    aiohttp_session: aiohttp.ClientSession = field(compare=False)


def bounded_connection(
    login: kopf.ConnectionInfo, answered: Answered = lambda _answer: None
) -> BoundedConnection:
    """The connection that kopf would make of a login, but reading to the bound.

    `answered` is called with each answer as it begins.
    """

    async def on_answer(_session: Any, _context: Any, answer: Answer) -> None:
        answered(answer)

    trace = aiohttp.TraceConfig()
    trace.on_request_end.append(on_answer)
    return BoundedConnection(
        server=login.server,
        default_namespace=login.default_namespace,
        priority=login.priority,
        expiration=login.expiration,
        made_from=login,
        aiohttp_session=aiohttp.ClientSession(
            connector=aiohttp.TCPConnector(limit=0, ssl=login.as_ssl_context()),
            headers=login.as_http_headers(),
            response_class=BoundedResponse,
            proxy=login.proxy_url,
            trust_env=login.trust_env,
            trace_configs=[trace],
        ),
    )
