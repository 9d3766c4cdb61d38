"""`python -m tests.fuzz.manifests.run`: the campaign against a control plane of its own.

Prints what it did, and ends with 1 where the operator died, was unhealthy, met an unexpected
fault, or let a canary wait.
"""

import argparse
import contextlib
import os
import random
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tests.fuzz.manifests import schema as schemas
from tests.fuzz.manifests.campaign import Campaign
from tests.fuzz.manifests.canary import Canaries
from tests.fuzz.manifests.health import Health
from tests.integration.control_plane import server
from tests.integration.control_plane.fake_driver import fake_driver
from tests.integration.control_plane.operator_process import OperatorProcess
from tests.integration.control_plane.release import (
    CLUSTER_WIDE,
    bound,
    find_helm,
    installed,
    job_namespace,
)
from tests.integration.control_plane.server import ControlPlane

FAILURES = schemas.ROOT / "build/fuzz-manifests"
# A trouble that only a person can mend ends a job within a batch or two.
STUCK_SECONDS = "8"


@contextlib.contextmanager
def control_plane() -> Iterator[ControlPlane]:
    """etcd, API server and controllers with this checkout's CRDs."""
    plane = server.prepare()
    try:
        plane.start(list(schemas.crds().values()))
        yield plane
    finally:
        plane.stop()


@contextlib.contextmanager
def operator(plane: ControlPlane, folder: Path) -> Iterator[OperatorProcess]:
    """The operator of this checkout, with the rights of the chart."""
    with installed(plane, folder, CLUSTER_WIDE, watched="") as release:
        settings = {
            "BAGPIPE_LEASE_NAMESPACE": release.namespace,
            "BAGPIPE_STUCK_SECONDS": STUCK_SECONDS,
        }
        process = OperatorProcess(release.kubeconfig, folder / "operator.log", settings)
        try:
            yield process.start()
        finally:
            process.kill()


@contextlib.contextmanager
def campaign(seed: int) -> Iterator[Campaign]:
    """Everything that a campaign needs, from processes of its own."""
    find_helm()
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="bagpipe-fuzz-")))
        plane = stack.enter_context(control_plane())
        process = stack.enter_context(operator(plane, folder))
        fuzzed = stack.enter_context(job_namespace(plane.admin))
        stack.enter_context(bound(plane.admin, fuzzed))
        canaries = Canaries(plane.admin, stack.enter_context(job_namespace(plane.admin)))
        driver = stack.enter_context(fake_driver("{}"))
        health = Health(process)
        stack.callback(health.stop)
        yield Campaign(seed, plane.admin, fuzzed, health, canaries, driver, FAILURES)


def main() -> int:
    """The module as a program; its exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seconds", type=float, help="how long batches are begun")
    parser.add_argument("--seed", type=int, default=random.randrange(2**32))
    parser.add_argument("--batch", type=int, default=0, help="the number of the first batch")
    given = parser.parse_args()
    print(f"seed {given.seed}, process {os.getpid()}", flush=True)
    failed = ""
    with campaign(given.seed) as it:
        it.canaries.learn()
        try:
            it.run(given.seconds, given.batch, lambda line: print(line, flush=True))
        except AssertionError as error:
            failed = str(error)
        for line in [*it.tally.lines(), it.canaries.summary(), it.health.summary()]:
            print(line)
        for odd in sorted(w for w in it.tally.counts if w.startswith("odd: ")):
            print(f"{it.tally.counts[odd]} times {odd}")
    print(f"FAILED (seed {given.seed}): {failed}" if failed else "none failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
