"""What a driver says of its job: over HTTP while it runs, in its termination message at the end.

The driver runs a user's job, so what it says is bounded and checked before it reaches a status.
"""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Literal

import aiohttp
from pydantic import AliasChoices, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from bagpipe_operator.api.names import PROGRESS_PORT
from bagpipe_operator.api.objects import Json

logger = logging.getLogger(__name__)

LONGEST_ANSWER = 64 * 1024
MOST_FAILURES = 5
# A job has at most 16 variants.
MOST_COMPARISONS = 16
LONGEST_MESSAGE = 1000
# Events may wake a job many times a second; its driver is asked this often at most.
LEAST_INTERVAL_SECONDS = 1.5
ASKED_WHILE_SILENT_SECONDS = 30.0


def _cut(longest: int) -> Callable[[object], object]:
    return lambda text: text[:longest] if isinstance(text, str) else text


Word = Annotated[str, BeforeValidator(_cut(253))]
Sentence = Annotated[str, BeforeValidator(_cut(LONGEST_MESSAGE))]
# More is no number to the API server, which would refuse the status for ever.
Count = Annotated[int, Field(ge=0, le=2**63 - 1)]


class _Model(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class Cases(_Model):
    """Cases by state."""

    planned: Count = 0
    running: Count = 0
    passed: Count = 0
    failed: Count = 0
    invalid: Count = 0
    errored: Count = 0
    crashed: Count = 0
    lost: Count = 0
    regressed: Count = 0
    quarantined: Count = 0
    # A driver of release 0.1 says `retried`.
    discarded: Annotated[Count, Field(validation_alias=AliasChoices("discarded", "retried"))] = 0

    @property
    def begun(self) -> bool:
        """Whether any case runs or has run."""
        return self.running + self.passed + self.failed + self.invalid + self.errored > 0

    @property
    def left(self) -> int:
        """How many have not ended."""
        return max(0, self.planned - self.passed - self.failed - self.invalid - self.errored)


class Ledger(_Model):
    """Messages, over the cases that count."""

    sent: Count = 0
    received: Count = 0
    dropped: Count = 0
    lead_in: Annotated[Count, Field(alias="leadIn")] = 0


class Failure(_Model):
    """One case that did not pass."""

    case: Word
    reason: Word
    message: Sentence


def _last_failures(failures: object) -> object:
    return failures[-MOST_FAILURES:] if isinstance(failures, list) else failures


class VariantComparison(_Model):
    """One variant, or the job, against its baseline."""

    variant: Word
    verdict: Literal["better", "worse", "same", "unknown"]
    regressed: Count
    fixed: Count
    flaky: Count


def _first_comparisons(comparisons: object) -> object:
    return comparisons[:MOST_COMPARISONS] if isinstance(comparisons, list) else comparisons


class Progress(_Model):
    """The driver's account; without `uid` and `attempt` it is an earlier release's."""

    uid: Word = ""
    attempt: Count = 0
    phase: Literal["Planning", "Running", "Complete", "Failed"]
    # Whether the driver has ended the job and waits for another one.
    ended: bool = False
    reason: Word = ""
    message: Sentence = ""
    warning: Sentence = ""  # a trouble of the driver's that may pass
    cases: Cases = Cases()
    ledger: Ledger = Ledger()
    verdict: Literal["Passed", "Failed", "Invalid", ""] = ""
    # The one word for it, of what decided; empty of a driver of an earlier release.
    verdict_reason: Annotated[Word, Field(alias="verdictReason")] = ""
    results: Annotated[str, BeforeValidator(_cut(2048))] = ""
    failures: Annotated[list[Failure], BeforeValidator(_last_failures)] = []
    comparisons: Annotated[list[VariantComparison], BeforeValidator(_first_comparisons)] = []

    def is_of(self, uid: str, attempt: int) -> bool:
        """Whether it may be of that attempt of the job with that UID.

        What says that it has ended and waits must name them: no earlier release's driver waits.
        """
        if self.ended:
            return (self.uid, self.attempt) == (uid, attempt)
        return self.uid in {"", uid} and self.attempt in {0, attempt}

    def as_status(self) -> Json:
        """The part of a job's status that comes from the driver."""
        verdict = {"verdict": self.verdict} if self.verdict else {}
        return verdict | {
            "cases": self.cases.model_dump(),
            "ledger": self.ledger.model_dump(by_alias=True),
            "results": self.results,
            "failures": [failure.model_dump() for failure in self.failures],
            "comparisons": [comparison.model_dump() for comparison in self.comparisons],
        }


def _goes_on(before: Progress | None, now: Progress, whose: tuple[str, int]) -> bool:
    """Whether an account may be of a driver's: one that has named its job does so each time."""
    return now.is_of(*whose) and (before is None or not before.uid or bool(now.uid))


def parse(text: str | bytes) -> Progress | None:
    """What the driver wrote, or None when it can't be read."""
    try:
        return Progress.model_validate_json(text)
    except ValidationError:
        return None


@dataclass
class _Answer:
    ip: str = ""
    whose: tuple[str, int] = ("", 0)
    progress: Progress | None = None
    taken: Progress | None = None  # what its job was decided by
    asked_at: float = float("-inf")
    is_asked: bool = False  # at this moment
    silent_since: float | None = None


@dataclass
class ProgressReader:
    """Asks drivers, each at most every LEAST_INTERVAL_SECONDS, and remembers their last answer.

    A driver is known by its pod's UID: the next one of the same job starts without an account.
    """

    session: aiohttp.ClientSession
    deadline_seconds: float
    port: int = PROGRESS_PORT
    counted: Callable[[bool], None] = lambda _answered: None
    _answers: dict[str, _Answer] = field(default_factory=dict)

    async def read(self, uid: str, ip: str, whose: tuple[str, int]) -> Progress | None:
        """The driver's last account; None as long as it has never answered.

        `whose`: the job's UID and the attempt. What another job's driver answers there is silence.
        """
        answer = self._answers.setdefault(uid, _Answer())
        if answer.progress is not None and not answer.progress.is_of(*whose):
            # Of the job that a driver of a pool had before, whose end nobody has forgotten yet.
            answer = self._answers[uid] = _Answer()
        answer.ip, answer.whose = ip, whose
        await self._renew(answer)
        answer.taken = answer.progress
        return answer.progress

    def unasked_for(self, seconds: float) -> list[str]:
        """The drivers that were asked before, and not for so long.

        But not those that are silent for ASKED_WHILE_SILENT_SECONDS: another pod may have the
        address by now, and a visit looks for them.
        """
        now = asyncio.get_running_loop().time()
        return [
            uid
            for uid, answer in self._answers.items()
            if answer.asked_at <= now - seconds
            and self.silent_seconds(uid) < ASKED_WHILE_SILENT_SECONDS
        ]

    def job_of(self, uid: str) -> str:
        """The UID of a driver's job; empty for a driver that is over."""
        answer = self._answers.get(uid)
        return answer.whose[0] if answer else ""

    async def ask(self, uid: str) -> tuple[Progress | None, Progress | None]:
        """Asks a driver beside its job's visits: what the last one took, and what it says now."""
        answer = self._answers.get(uid)
        if answer is None:
            return None, None
        await self._renew(answer)
        return answer.taken, answer.progress

    async def _renew(self, answer: _Answer) -> None:
        """Asks, unless that was just done, or is: answers must not overtake each other."""
        now, whose = asyncio.get_running_loop().time(), answer.whose
        if answer.is_asked or now - answer.asked_at < LEAST_INTERVAL_SECONDS:
            return
        answer.asked_at, answer.is_asked = now, True
        try:
            progress = await self._ask(answer.ip)
        finally:
            answer.is_asked = False
        if progress is not None and not _goes_on(answer.progress, progress, whose):
            # The pod is gone, the watch does not know it yet, and another has its address.
            logger.info("%s answers for job %s, not for %s", answer.ip, progress.uid, whose[0])
            progress = None
        self.counted(progress is not None)
        if progress is None:
            answer.silent_since = answer.silent_since if answer.silent_since is not None else now
        else:
            answer.progress, answer.silent_since = progress, None

    async def works(self, ip: str) -> bool | None:
        """Whether the driver at that address has a job, whichever; None where none answers."""
        progress = await self._ask(ip)
        return None if progress is None else not progress.ended

    def silent_seconds(self, uid: str) -> float:
        """How long the driver has not answered; 0 when it did the last time."""
        answer = self._answers.get(uid)
        if answer is None or answer.silent_since is None:
            return 0.0
        return asyncio.get_running_loop().time() - answer.silent_since

    def forget(self, uid: str) -> None:
        """Drops what is remembered of a driver that is over."""
        self._answers.pop(uid, None)

    async def _ask(self, ip: str) -> Progress | None:
        url = driver_url(ip, self.port, "progress")
        timeout = aiohttp.ClientTimeout(total=self.deadline_seconds)
        try:
            async with self.session.get(url, timeout=timeout, allow_redirects=False) as response:
                body = await read_bounded(response.content, LONGEST_ANSWER)
                return parse(body) if response.status == 200 else None
        except (aiohttp.ClientError, TimeoutError, ValueError) as error:
            # A driver that still starts answers nothing; the pod's own state shows what matters.
            logger.debug("no progress from %s: %s", ip, error)
            return None


def driver_url(ip: str, port: int, what: str) -> str:
    """Where a driver's pod serves that; addresses of IPv6 need brackets."""
    host = f"[{ip}]" if ":" in ip else ip
    return f"http://{host}:{port}/{what}"


async def read_bounded(stream: aiohttp.StreamReader, limit: int) -> bytes:
    """All of a body of at most `limit` bytes; raises ValueError for a longer one."""
    body = bytearray()
    async for chunk in stream.iter_chunked(16 * 1024):
        body += chunk
        if len(body) > limit:
            raise ValueError(f"the answer is longer than {limit} bytes")
    return bytes(body)
