"""A campaign: batches of fuzzed manifests against a real API server and a real operator.

Of ten batches the last three are written while the CRDs let anything pass, as a CRD of another
release or an administrator's may; what was stored then is still there when the next batch comes.
"""

import concurrent.futures
import copy
import json
import random
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from tests.fuzz.manifests import forged
from tests.fuzz.manifests import schema as schemas
from tests.fuzz.manifests.canary import Canaries
from tests.fuzz.manifests.case import PLURALS, Case, attempt
from tests.fuzz.manifests.generator import Manifest, seeded
from tests.fuzz.manifests.health import Health
from tests.fuzz.manifests.tally import Tally
from tests.fuzz.manifests.values import Json
from tests.integration.control_plane.client import JOBS as BASE
from tests.integration.control_plane.client import Client, core
from tests.integration.control_plane.fake_driver import FakeDriver
from tests.integration.control_plane.server import CRDS
from tests.waiting import PATIENCE, wait_until

BATCH = 400
# Of so many batches the last ones: each change of a CRD costs the API server seconds.
ROUND, LAX_OF_ROUND = 10, 3
WORKERS = 6
# Drivers that get a status which somebody forged; the rest are left as they are.
_FORGED_DRIVERS = 0.6


def any_schema() -> Json:
    """The schema of a CRD that lets everything pass."""
    return {"type": "object", "x-kubernetes-preserve-unknown-fields": True}


@dataclass
class Campaign:
    """What a run needs; `seed` and a batch's number decide all that the batch writes."""

    seed: int
    client: Client
    namespace: str
    health: Health
    canaries: Canaries
    driver: FakeDriver
    failures: Path
    tally: Tally = field(default_factory=Tally)
    _lax: bool = False
    _counted: set[str] = field(default_factory=set)

    def run(self, seconds: float, first: int, report: Callable[[str], None]) -> None:
        """Batches until the time is over; raises AssertionError for the first that failed."""
        until, number = time.monotonic() + seconds, first
        while time.monotonic() < until:
            lax = number % ROUND >= ROUND - LAX_OF_ROUND
            self._set_crds(lax)
            cases = self._cases(number, lax)
            try:
                self._batch(number, cases)
            except AssertionError as error:
                raise AssertionError(self._saved(number, cases, error)) from error
            report(f"batch {number}{' (any CRD)' if lax else ''}: {self.canaries.summary()}")
            number += 1
        self._set_crds(False)
        # Over what was stored while the CRDs let anything pass.
        self.canaries.fly()
        self.health.check()

    def _cases(self, number: int, lax: bool) -> list[Case]:
        generator = seeded_batch(self.seed, number, lax)
        return [
            Case(
                self.client, self.namespace, f"b{number}-{index}", manifest,
                f"{self.seed}/{number}/{index}", lax, self.tally,
            )
            for index, manifest in enumerate(generator)
        ]  # fmt: skip

    def _batch(self, number: int, cases: list[Case]) -> None:
        self.driver.account = forged.account(random.Random(f"{self.seed}/{number}"))
        with concurrent.futures.ThreadPoolExecutor(WORKERS) as pool:
            for done in [pool.submit(case.live) for case in cases]:
                done.result()
            # Amid the operator's work, not after it.
            self.canaries.fly()
            self._forge_drivers(number, pool)
            self.canaries.fly()
            self.health.check()
            self._count_ends()
            # Not what this one has made: the operator has the next one's time for it.
            self._remove_older_than(number, pool)

    def _forge_drivers(self, number: int, pool: concurrent.futures.Executor) -> None:
        """Gives the drivers that the operator has made the statuses of a kubelet that lies."""
        rng, asked = random.Random(f"{self.seed}/{number}/drivers"), []
        for pod in self.client.items(core(self.namespace, "pods")):
            status = forged.pod_status(rng)
            if rng.random() < _FORGED_DRIVERS:
                status |= {"podIP": self.driver.ip} if rng.random() < 0.3 else {}
                path = core(self.namespace, "pods", pod["metadata"]["name"]) + "/status"
                asked.append(pool.submit(self._forge, path, {"status": status}))
        for done in asked:
            done.result()

    def _forge(self, path: str, body: Json) -> None:
        done = attempt(self.client, self.tally, "PATCH", path, body)
        self.tally.add("pod statuses" if done is not None else "pod statuses refused")

    def _count_ends(self) -> None:
        self.tally.counts["answers"] = self.driver.asked
        for job in self.client.items(f"{BASE}/namespaces/{self.namespace}/simulationjobs"):
            uid = job["metadata"]["uid"]
            reason = ended_by(job.get("status"))
            if reason and uid not in self._counted:
                self._counted.add(uid)
                self.tally.end(reason)

    def _remove_older_than(self, number: int, pool: concurrent.futures.Executor) -> None:
        """Keeps the API server small: all that batches before this one have made goes."""
        below = [f"{BASE}/namespaces/{self.namespace}/{plural}" for plural in PLURALS.values()]
        below += [core(self.namespace, resource) for resource in ("pods", "configmaps")]
        old = [
            f"{path}/{name}"
            for path in below
            for name in self._names(path)
            if not name.startswith((f"b{number}-", "kube-root-ca"))
        ]
        for done in [pool.submit(self.client.delete, path, 0) for path in old]:
            done.result()
        self.client.call("DELETE", core(self.namespace, "events"))

    def _names(self, path: str) -> list[str]:
        return [each["metadata"]["name"] for each in self.client.items(path)]

    def _set_crds(self, lax: bool) -> None:
        """Makes both CRDs let anything pass, or this checkout's again, and waits for the effect."""
        if lax == self._lax:
            return
        for kind, crd in schemas.crds().items():
            path = f"{CRDS}/{crd['metadata']['name']}"
            wanted = copy.deepcopy(schemas.whole(kind)) if not lax else any_schema()
            live = self.client.get(path)
            version = live["spec"]["versions"][0]
            version["schema"]["openAPIV3Schema"] = wanted
            # What can be selected by must be in the schema.
            selectable = crd["spec"]["versions"][0].get("selectableFields", [])
            version["selectableFields"] = [] if lax else selectable
            self.client.call("PUT", path, live)
            probe = {"apiVersion": "sim.bagpipe.io/v1alpha1", "kind": kind,
                     "metadata": {"name": "probe"}, "spec": 5}  # fmt: skip
            below = f"{BASE}/namespaces/{self.namespace}/{PLURALS[kind]}?dryRun=All"

            def taken(below: str = below, probe: Json = probe) -> bool:
                return attempt(self.client, self.tally, "POST", below, probe) is not None

            wait_until(lambda: taken() is lax, PATIENCE, "the CRD did not change")
        self._lax = lax

    def _saved(self, number: int, cases: list[Case], error: AssertionError) -> str:
        """Writes down what the batch has written; what failed, and how to do it again."""
        self.failures.mkdir(parents=True, exist_ok=True)
        path = self.failures / f"seed-{self.seed}-batch-{number}.json"
        objects = [case.manifest.object for case in cases]
        path.write_text(json.dumps({"error": str(error), "manifests": objects}, indent=1))
        again = f"make fuzz TARGET=manifests SEED={self.seed} BATCH={number} SECONDS=1"
        return f"{error}\nIts manifests are in {path}. Again: {again}"


def seeded_batch(seed: int, number: int, lax: bool) -> list[Manifest]:
    """The manifests of one batch."""
    generator = seeded(f"{seed}/{number}", lax)
    return [generator.manifest() for _ in range(BATCH)]


def ended_by(status: Json) -> str:
    """The reason for which a job has ended, with its phase; empty as long as it has not."""
    conditions = status.get("conditions") if isinstance(status, dict) else None
    for condition in conditions if isinstance(conditions, list) else ():
        if isinstance(condition, dict) and condition.get("status") == "True":
            type_, reason = condition.get("type"), str(condition.get("reason"))
            if type_ in {"Complete", "Failed"}:
                return f"{type_}/{reason[:40]}"
    return ""
