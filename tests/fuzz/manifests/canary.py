"""A job in a namespace of its own that must become Complete in its usual time, whatever others do.

The fake kubelet plays its driver, so that all the time which passes is the operator's and the API
server's.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.fake_kubelet import FakeKubelet
from tests.integration.control_plane.observe import a_job
from tests.integration.control_plane.operators.stalls import Stalls
from tests.unit.operator.builders import account
from tests.waiting import wait_until

# A late canary is one that took so much longer than the usual one. Most of it is for a machine
# that others use too: a canary of a busy operator takes a second.
LATE_SECONDS = 10.0
# It is waited for so long, to say how late it was.
LONGEST_SECONDS = 60.0
USUAL_OF = 5


class CanaryError(AssertionError):
    """A canary that was late, or that did not end as it should; the message says which."""


@dataclass
class Canaries:
    """One after the other, with the seconds that each took."""

    admin: Client
    namespace: str
    seconds: list[float] = field(default_factory=list)
    usual: float = 0.0

    def learn(self) -> None:
        """Takes the time of some canaries of an idle operator as the usual one."""
        for _ in range(USUAL_OF):
            self.fly()
        self.usual = statistics.median(self.seconds)
        self.seconds.clear()

    def fly(self) -> float:
        """Runs one; its seconds without those in which the machine stood still.

        Raises CanaryError.
        """
        name = f"canary-{time.monotonic_ns() // 1_000_000}"
        with Stalls() as stalls:
            began = time.monotonic()
            job = self._run(name)
            took = time.monotonic() - began - stalls.seconds
        self.admin.delete(jobs(self.namespace, name))
        self._judge(job["status"])
        if self.usual and took > self.usual + LATE_SECONDS:
            raise CanaryError(f"a canary took {took:.1f} s, and {self.usual:.1f} s is usual")
        self.seconds.append(took)
        return took

    def _run(self, name: str) -> Object:
        driver, kubelet = f"{name}-1-driver", FakeKubelet(self.admin)
        path = jobs(self.namespace, name)
        self.admin.create(jobs(self.namespace), a_job(name))
        pod = core(self.namespace, "pods", driver)
        self._await(lambda: self.admin.exists(pod), "a canary got no driver")
        kubelet.run(self.namespace, driver)
        kubelet.end(self.namespace, driver, 0, account("Complete", verdict="Passed"))

        def ended() -> bool:
            phase = (self.admin.get(path).get("status") or {}).get("phase")
            return phase in {"Complete", "Failed"}

        self._await(ended, "a canary did not end")
        return self.admin.get(path)

    @staticmethod
    def _await(done: Callable[[], bool], what: str) -> None:
        try:
            wait_until(done, LONGEST_SECONDS, f"{what} within {LONGEST_SECONDS:g} s")
        except AssertionError as error:
            raise CanaryError(str(error)) from None

    @staticmethod
    def _judge(status: Object) -> None:
        found = {c["type"]: c["status"] for c in status["conditions"]}
        right = {"Complete": "True", "Failed": "False", "Passed": "True"}
        if {type_: found.get(type_) for type_ in right} != right:
            raise CanaryError(f"a canary ended as {status['phase']} with {found}")

    def summary(self) -> str:
        """How many flew, and in which time."""
        if not self.seconds:
            return "no canary"
        return (
            f"{len(self.seconds)} canaries: median {statistics.median(self.seconds):.2f} s, "
            f"worst {max(self.seconds):.2f} s (idle: {self.usual:.2f} s)"
        )
