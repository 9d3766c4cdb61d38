"""One try to notify one receiver over HTTP, with all that is waited for and read bounded."""

import asyncio
import logging
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import aiohttp
from aiohttp.abc import AbstractResolver, ResolveResult

from bagpipe_operator.notify.letter import Answer, Letter
from bagpipe_operator.notify.signature import LARGEST_FILE, UnusableKeyError, read_keys, signed
from bagpipe_operator.receivers import Receiver
from bagpipe_operator.runtime.metrics import RELEASE

logger = logging.getLogger(__name__)

DEADLINE_SECONDS = 10.0
# Of what a receiver answers nothing is used; so much is read, as some mind not being read at all.
LARGEST_ANSWER = 16 * 1024
LONGEST_WAIT_SECONDS = 600.0
MEDIA_TYPE = "application/cloudevents+json; charset=utf-8"


class _Resolver(AbstractResolver):
    """Looks names up in a thread of the receiver's own: a name server that hangs holds up no other
    receiver, nor the calls to the API server.
    """

    def __init__(self, thread: ThreadPoolExecutor) -> None:
        self._thread = thread

    async def resolve(
        self, host: str, port: int = 0, family: socket.AddressFamily = socket.AF_UNSPEC
    ) -> list[ResolveResult]:
        found = await asyncio.get_running_loop().run_in_executor(
            self._thread, lambda: socket.getaddrinfo(host, port, family, socket.SOCK_STREAM)
        )
        return [_resolved(host, each) for each in found]

    async def close(self) -> None:
        """Nothing is kept."""


def _resolved(host: str, found: tuple[Any, ...]) -> ResolveResult:
    family, _, proto, _, address = found
    return ResolveResult(
        hostname=host, host=address[0], port=address[1], family=family, proto=proto,
        flags=socket.AI_NUMERICHOST,
    )  # fmt: skip


@dataclass
class Sender:
    """Sends to one receiver; its key is read each time, so that a new one is used at once."""

    receiver: Receiver
    keys: Path  # the file that the receiver's Secret is mounted as
    now: Callable[[], datetime]
    deadline_seconds: float = DEADLINE_SECONDS
    trust_env: bool = False  # whether a proxy of the environment is used
    _thread: ThreadPoolExecutor = field(init=False)
    _session: aiohttp.ClientSession | None = None

    def __post_init__(self) -> None:
        name = f"notify-{self.receiver.name}"
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix=name)

    async def post(self, letter: Letter) -> Answer:
        """One try, over after the deadline; it raises nothing that a receiver can bring about."""
        status = 0
        wait = 0.0
        try:
            async with asyncio.timeout(self.deadline_seconds):
                headers = await self._headers(letter)
                async with self._opened().post(
                    self.receiver.url, data=letter.body, headers=headers, allow_redirects=False
                ) as response:
                    wait = _asked_for(response.headers.get("Retry-After", ""))
                    status = response.status
                    await _read_some(response.content)
        except UnusableKeyError as error:
            return Answer(False, f"its key can't be used: {error}")
        except TimeoutError:
            if not status:
                return Answer(False, f"it did not answer within {self.deadline_seconds:g} s")
        except (aiohttp.ClientError, OSError, ValueError) as error:
            # The text of such an error may hold the address, which may be a secret.
            if not status:
                return Answer(False, f"it can't be reached ({type(error).__name__})")
        return _judged(status, wait)

    async def close(self) -> None:
        """Ends the connections; a thread that still looks a name up is left to itself."""
        if self._session is not None:
            await self._session.close()
        self._thread.shutdown(wait=False, cancel_futures=True)

    async def _headers(self, letter: Letter) -> dict[str, str]:
        loop = asyncio.get_running_loop()
        keys = read_keys(await loop.run_in_executor(self._thread, self._read_file))
        seconds = int(self.now().timestamp())
        return {
            "Content-Type": MEDIA_TYPE,
            "User-Agent": f"bagpipe-operator/{RELEASE}",
        } | signed(keys, letter.identity, seconds, letter.body)

    def _read_file(self) -> bytes:
        try:
            with self.keys.open("rb") as file:
                return file.read(LARGEST_FILE + 1)
        except OSError as error:
            words = f"the Secret's key `key` is not there ({type(error).__name__})"
            raise UnusableKeyError(words) from None

    def _opened(self) -> aiohttp.ClientSession:
        if self._session is None:
            self._session = aiohttp.ClientSession(
                # A connection for each try: an answer that was not read to its end is just closed.
                connector=aiohttp.TCPConnector(
                    force_close=True, resolver=_Resolver(self._thread), use_dns_cache=False
                ),
                # What is packed small may be large when it is unpacked.
                auto_decompress=False,
                cookie_jar=aiohttp.DummyCookieJar(),
                timeout=aiohttp.ClientTimeout(total=self.deadline_seconds),
                trust_env=self.trust_env,
            )
        return self._session


async def _read_some(content: aiohttp.StreamReader) -> None:
    read = 0
    while read < LARGEST_ANSWER:
        chunk = await content.read(LARGEST_ANSWER - read)
        if not chunk:
            return
        read += len(chunk)


def _asked_for(text: str) -> float:
    """Seconds of a Retry-After; a date, or nonsense, asks for nothing."""
    if not (text.isascii() and text.isdecimal() and len(text) < 10):
        return 0.0
    return min(float(text), LONGEST_WAIT_SECONDS)


def _judged(status: int, wait: float) -> Answer:
    if 200 <= status < 300:
        return Answer(True)
    if 300 <= status < 400:
        words = f"it answered {status}, a redirect, and none is followed: write the address itself"
        return Answer(False, words)
    if status == 410:
        return Answer(False, "it answered 410: it wants no notifications any more", final=True)
    return Answer(False, f"it answered {status}", wait_seconds=wait)
