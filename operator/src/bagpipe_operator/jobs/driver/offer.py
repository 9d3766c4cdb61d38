"""A job is offered to a driver that waits: its description goes there, its answer comes back."""

import logging
from dataclasses import dataclass

import aiohttp

from bagpipe_operator.api.names import PROGRESS_PORT
from bagpipe_operator.jobs.driver.progress import driver_url, read_bounded
from bagpipe_operator.jobs.pools.handover import Received

logger = logging.getLogger(__name__)

_LONGEST_ANSWER = 64
# What a driver may answer; `unknown` means that it could not look the job up, and may be asked
# again.
_ANSWERS: dict[bytes, Received] = {
    b"taken": "taken", b"ended": "ended", b"refused": "refused", b"unknown": "silent",
}  # fmt: skip


@dataclass
class DriverOffers:
    """Offers jobs over HTTP."""

    session: aiohttp.ClientSession
    deadline_seconds: float
    port: int = PROGRESS_PORT

    async def offer(self, ip: str, description: bytes) -> Received:
        """What the driver there answers to a job.json."""
        timeout = aiohttp.ClientTimeout(total=self.deadline_seconds)
        try:
            async with self.session.post(
                driver_url(ip, self.port, "job"),
                data=description,
                headers={"Content-Type": "application/json"},
                timeout=timeout,
                allow_redirects=False,
            ) as response:
                body = await read_bounded(response.content, _LONGEST_ANSWER)
                return _ANSWERS.get(body, "silent") if response.status == 200 else "silent"
        except (aiohttp.ClientError, TimeoutError, ValueError) as error:
            logger.info("%s does not answer the offer of a job: %s", ip, error)
            return "silent"
