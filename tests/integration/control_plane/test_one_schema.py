"""The API server and the models take the same jobs: random manifests, as both see them.

What the API server lets pass and the models refuse ends a job as SpecInvalid, after its author has
gone; what it refuses and the models take would run on a laptop and on no cluster.
"""

import json
import random
import re
from collections import Counter
from dataclasses import dataclass, field

from embedded.api import ApiError
from pydantic import ValidationError

from bagpipe.spec import SimulationJobSpec
from bagpipe_operator.jobs.pods.job_config import plain_spec
from tests.fuzz.manifests.generator import JOB, Generator
from tests.integration.control_plane.client import Client, Object, jobs

SEED, COUNT = 13, 2000
# What a structural schema can't say: objects whose keys or shapes are free, sentences about
# patterns, lists and products of other fields, and the hosts of a thousand URIs, which the budget
# of rules does not hold. docs/reference/api-changes.md names them.
_LATE = re.compile(
    r"matrix\b|spark\.executors\b|source\.simulator\b|stack\.parameters\.|variants\.\d+\.parameters\."
    r"|source\.((bags|files|sequence)\.\d+|catalogue\.(uri|within\.\d+)).*has no known scheme"
    r"|: Value error, (evaluate\[.*reads .*record\.topics|the step's trigger"
    r"|stack\.parameters has .*which names no node)"
)
# What only a cluster has is refused there, and of no concern on a laptop.
_CLUSTER_S = re.compile(
    r"spec\.(spark\.(driver|executor)\.(pod|resources|volumeMounts)"
    r"|stack\.(resources|securityContext))\b"
)
# A laptop reads its own disk, has no etcd whose objects are bounded in size, takes "yes" and 1 for
# true, as YAML's readers do, and an empty list of bags, pieces or files for none.
_LAPTOP_S = re.compile(
    r"file:// reaches only what is mounted below /mnt|Too long|Too many|must be of type boolean"
    r"|source\.(bags|sequence|files) must (have|name) at least one"
)
_PATH = re.compile(r"(spec(?:\.[A-Za-z]+(?:\[[^\]]*\])*)+): [A-Z]")


@dataclass
class Seen:
    """How often both agreed, and each case in which they did not, with the messages."""

    agreed: Counter[str] = field(default_factory=Counter)
    late: list[str] = field(default_factory=list)
    early: list[str] = field(default_factory=list)

    def look(self, admin: Client, job: Object) -> None:
        """Ask both for one job."""
        try:
            spec = admin.call("POST", jobs("default") + "?dryRun=All", job)["spec"]
        except ApiError as error:
            self._refused(job, str(error))
            return
        message = refusal(spec)
        if message and not _LATE.match(message):
            self.late.append(message)
        else:
            self.agreed["late" if message else "taken"] += 1

    def _refused(self, job: Object, message: str) -> None:
        paths = [path for path in _PATH.findall(message) if not _CLUSTER_S.match(path)]
        if _LAPTOP_S.search(message):
            paths = []
        if paths and isinstance(job.get("spec"), dict) and not refusal(job["spec"]):
            self.early.append((message.partition("is invalid: ")[2] or message)[:300])
        else:
            self.agreed["refused"] += 1


def refusal(spec: Object) -> str:
    """Where and why the models refuse a spec; empty where they take it."""
    try:
        SimulationJobSpec.model_validate(plain_spec(spec))
    except ValidationError as error:
        first = error.errors()[0]
        return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    except (AttributeError, TypeError, ValueError) as error:
        return f"spec: {error}"  # of a shape that no schema lets pass
    return ""


def test_the_api_server_and_the_models_take_the_same_jobs(admin: Client) -> None:
    made, seen = Generator(random.Random(SEED)), Seen()  # noqa: S311  no secret
    for _ in range(COUNT):
        job = made.manifest(JOB).object | {"metadata": {"name": "x"}}
        json.dumps(job)
        seen.look(admin, job)
    assert "\n".join(seen.late) == ""
    print("\n".join(seen.early))
    assert "\n".join(seen.early) == ""
    assert seen.agreed["taken"] > 0.25 * COUNT
    assert seen.agreed["refused"] > 0.25 * COUNT
    assert 0 < seen.agreed["late"] < 0.1 * COUNT
