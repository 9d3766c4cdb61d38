"""Looks for drivers, also where the view may be behind, and for what they report."""

from collections.abc import Callable
from typing import Protocol

from bagpipe_operator.cluster.client import Api, get_if_there
from bagpipe_operator.jobs.claim import driver_name
from bagpipe_operator.jobs.driver.ending import Ending, lost_driver
from bagpipe_operator.jobs.driver.progress import Progress
from bagpipe_operator.jobs.driver.rounds import Rounds, serves
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.view import View
from bagpipe_operator.runtime.patience import Patience

# A driver that has been silent for this long is looked for: the watch may have lost its end.
SILENT_DRIVER_SECONDS = 30.0


class Accounts(Protocol):
    """Who asks drivers for their progress; each is known by its pod's UID."""

    async def read(self, uid: str, ip: str, whose: tuple[str, int]) -> Progress | None:
        """The last account of the driver of a job's (UID's) attempt."""

    def silent_seconds(self, uid: str) -> float:
        """How long it has not answered."""

    def forget(self, uid: str) -> None:
        """Nobody will ask it again."""


class DriverLookup:
    """One per operator. Every method that asks raises ApiError."""

    def __init__(
        self,
        api: Api,
        view: View,
        accounts: Accounts,
        missing_seconds: float,
        monotonic: Callable[[], float],
    ) -> None:
        self._api = api
        self._view = view
        self._accounts = accounts
        self._missing_seconds = missing_seconds
        self._monotonic = monotonic
        self._asked: dict[str, str] = {}  # the driver last asked, by its job
        self.begin_to_lead()

    def begin_to_lead(self) -> None:
        """Forgets what was seen when this replica led before: another may have led since."""
        self._missing, self._rounds = Patience(), Rounds(self._monotonic)
        for uid in list(self._asked):
            self._forget_driver(uid)

    async def look_for(
        self, job: JobView, attempt: int, at_once: bool
    ) -> tuple[PodView | None, Ending | None]:
        """A driver that may be there and is not in sight: wait for the watch, then ask."""
        name = driver_name(job.name, attempt, job.status)
        missing_for = self._missing.observe(job.uid, [name], self._monotonic())[name]
        went = next((p for p in self._view.gone_pods(job.uid) if p.name == name), None)
        at_once = at_once or went is not None
        if not at_once and missing_for < self._missing_seconds:
            return None, None
        driver = await self.pod(job.namespace, name)
        if driver is None or driver.job_uid != job.uid:
            return None, lost_driver(job.namespace, name, went)
        return driver, None

    async def account_of(self, driver: PodView) -> Progress | None:
        """The account of this driver; what the one before it reported is not its account."""
        if self._asked.get(driver.job_uid) != driver.uid:
            self._forget_driver(driver.job_uid)
        self._asked[driver.job_uid] = driver.uid
        whose = (driver.job_uid, driver.attempt)
        return await self._accounts.read(driver.uid, driver.ip, whose)

    async def refreshed_if_silent(self, driver: PodView) -> PodView | None:
        """The driver as it is now if it was silent for long; None when it is gone."""
        self._missing.forget(driver.job_uid)
        silent = self._accounts.silent_seconds(driver.uid) >= SILENT_DRIVER_SECONDS
        if serves(driver) and not silent:
            self._rounds.forget(driver.job_uid)
            return driver
        if driver.ended or not self._rounds.due(driver, at_once=silent):
            return driver
        live = await self.refreshed(driver)
        self._rounds.looked(driver)
        return live

    async def refreshed(self, pod: PodView) -> PodView | None:
        """The pod as the API server has it, and the view from now on; None when it is gone."""
        live = await self.pod(pod.namespace, pod.name)
        if live is None or live.uid != pod.uid:
            self._view.drop_pod(pod)
            return None
        return live

    async def pod(self, namespace: str, name: str) -> PodView | None:
        """A pod as the API server has it, which the view has from now on; None for none."""
        found = await get_if_there(self._api, "pods", namespace, name)
        if found is None:
            return None
        pod = PodView.from_object(found)
        self._view.put_pod(pod)
        return self._view.shown(pod)

    def forget(self, uid: str) -> None:
        """Of a job that has ended, rests or is gone nothing is kept."""
        self._missing.forget(uid)
        self._rounds.forget(uid)
        self._forget_driver(uid)

    def _forget_driver(self, uid: str) -> None:
        asked = self._asked.pop(uid, None)
        if asked is not None:
            self._accounts.forget(asked)
