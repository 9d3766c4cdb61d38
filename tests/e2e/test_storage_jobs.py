"""Recordings and results on a real S3 server and a real HDFS: the results of the volume's job.

Three jobs run at once, the same but for their URIs; what the cluster says of them is kept all
the while and searched for the credentials.
"""

import base64
import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field

import pytest

from bagpipe.storage import Storage
from tests.e2e import jobs
from tests.e2e import kubectl as k
from tests.e2e.storage_servers import hdfs_of_the_cluster, s3_of_the_cluster
from tests.recording import fetch

pytestmark = pytest.mark.e2e

KINDS = ("pvc", "s3", "hdfs")
REMOTE = KINDS[1:]
FRAGMENTS = 4
_MOST_BYTES = 64 << 20
# The program waits for it, so that no executor goes before its log was read.
_COLLECTED = "/tmp/collected"
_CAT = ["sh", "-c", f"until [ -e {_COLLECTED} ]; do sleep 0.1; done; exec cat"]
# What a Secret holds and is no secret: where a server is, and which region it plays.
_PUBLIC = {"AWS_ENDPOINT_URL", "AWS_REGION"}


def make_job(kind: str, folder: str) -> k.Object:
    """Fragments of the real recording through a program that gives them back as they are."""
    remote = {"storage": {"secrets": [f"{kind}-login"]}}
    return {
        "apiVersion": "sim.bagpipe.io/v1alpha1",
        "kind": "SimulationJob",
        "metadata": {"name": f"on-{kind}"},
        "spec": {
            "source": {"bags": [f"{folder}/pr2/*.bag"], "fragment": {"length": "4s"}},
            "stack": {
                "engine": "exec", "image": "bagpipe.local/spark:0.2.0", "command": _CAT,
            },
            "spark": jobs.spark(1, 2),
            "output": {"uri": f"{folder if kind in REMOTE else 'pvc://results'}/out"},
            **(remote if kind in REMOTE else {}),
        },
    }  # fmt: skip


def apply_login(namespace: str, name: str, values: dict[str, str]) -> None:
    """Create a Secret."""
    metadata = {"name": name, "namespace": namespace}
    secret = {"apiVersion": "v1", "kind": "Secret", "metadata": metadata, "stringData": values}
    k.kubectl("apply", "-f", "-", given=json.dumps(secret))


@dataclass
class Collected:
    """Everything but the Secrets that the cluster showed while the jobs ran."""

    namespace: str
    objects: set[str] = field(default_factory=set)
    logs: dict[str, str] = field(default_factory=dict)

    def look(self) -> list[k.Object]:
        """Keep what there is now; gives the jobs."""
        found = k.items(self.namespace, "simulationjobs,pods,configmaps,events")
        for each in found:
            self.objects.add(json.dumps(each))
            if each["kind"] == "Pod" and each["metadata"]["name"] != k.TOOLBOX:
                self._collect(each["metadata"]["name"])
        return [each for each in found if each["kind"] == "SimulationJob"]

    def _collect(self, pod: str) -> None:
        try:
            log = k.kubectl("-n", self.namespace, "logs", pod, "--all-containers", "--prefix")
        except k.KubectlError:
            return  # its containers have not started, or it is gone
        self.logs[pod] = max(log, self.logs.get(pod, ""), key=len)
        if "-exec-" in pod:
            go_on = ("exec", pod, "-c", "stack", "--", "touch", _COLLECTED)
            with suppress(k.KubectlError):  # it has done its work, and is going
                k.kubectl("-n", self.namespace, *go_on)


@dataclass
class Ran:
    """Three jobs that ended: their status, what was collected, and how to read their results."""

    status: dict[str, k.Object]
    collected: Collected
    hidden: list[str]
    namespace: str

    def shown(self, text: str) -> bool:
        """Whether it holds anything of what is hidden."""
        return any(hidden in text for hidden in self.hidden)

    def read(self, kind: str, name: str) -> bytes:
        """A file below a job's results."""
        uri = f"{self.status[kind]['results']}/{name}"
        if kind in REMOTE:
            return Storage({}).read_all(uri, _MOST_BYTES)
        path = "/" + uri.removeprefix("pvc://")
        return base64.b64decode(k.in_toolbox(self.namespace, "base64", path))

    def names(self, kind: str, folder: str) -> list[str]:
        """The names in a folder of a job's results."""
        uri = f"{self.status[kind]['results']}/{folder}"
        if kind in REMOTE:
            return Storage({}).names(uri)
        path = "/" + uri.removeprefix("pvc://")
        return k.in_toolbox(self.namespace, "ls", "-A", path).split()


@pytest.fixture(scope="module")
def ran(
    namespace: str, recordings: None, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Ran]:
    """The three jobs, applied at once, until all have ended."""
    del recordings  # on the claim, for the job whose results are the measure
    if os.geteuid() or k.tool_environment()["KUBECONFIG"] != k.EMBEDDED_KUBECONFIG:
        pytest.skip("the servers run beside the embedded cluster, which needs root")
    with ExitStack() as stack:
        servers = {
            "s3": stack.enter_context(s3_of_the_cluster(tmp_path_factory.mktemp("s3"))),
            "hdfs": stack.enter_context(hdfs_of_the_cluster(tmp_path_factory.mktemp("hdfs"))),
        }
        hidden = []
        for kind, (folder, login) in servers.items():
            with Storage({}).create(f"{folder}/pr2/joint_states.bag") as file:
                file.write(fetch().read_bytes())
            apply_login(namespace, f"{kind}-login", login)
            hidden += [value for name, value in login.items() if name not in _PUBLIC]
        folders = {kind: folder for kind, (folder, _) in servers.items()}
        for kind in KINDS:
            job = make_job(kind, folders.get(kind, "pvc://recordings"))
            stack.enter_context(jobs.applied(namespace, job))
        collected = Collected(namespace)
        yield Ran(await_all(collected), collected, hidden, namespace)


def await_all(collected: Collected) -> dict[str, k.Object]:
    """Kind -> the status of its job, once all three have ended."""

    def look() -> dict[str, k.Object] | None:
        status = {each["metadata"]["name"]: each.get("status", {}) for each in collected.look()}
        own = {kind: status[f"on-{kind}"] for kind in KINDS}
        phases = {each.get("phase") for each in own.values()}
        return own if phases <= {"Complete", "Failed"} else None

    return k.await_that("the jobs on a volume, S3 and HDFS to end", look, 400, every=3)


@pytest.mark.parametrize("kind", REMOTE)
def test_the_results_are_those_of_the_job_on_a_volume(ran: Ran, kind: str) -> None:
    assert (ran.status[kind]["phase"], ran.status[kind]["verdict"]) == ("Complete", "Passed")
    assert ran.status[kind]["cases"]["passed"] == FRAGMENTS
    outcome = {each: outputs(ran, each) for each in ("pvc", kind)}
    assert len(outcome[kind]) == FRAGMENTS
    assert outcome[kind] == outcome["pvc"]
    assert ran.status[kind]["results"].startswith(f"{kind}://")


def outputs(ran: Ran, kind: str) -> dict[str, tuple[str, list[int], str]]:
    """Case -> outcome, window, and the digest of the bag that came back, of a job's results."""
    manifest = json.loads(ran.read(kind, "manifest.json"))
    rows = [json.loads(line) for line in ran.read(kind, "results.jsonl").splitlines()]
    assert [entry["case"] for entry in manifest["cases"]] == [row["case"] for row in rows]
    recorded = [row["recorded"][0] for row in rows]
    assert [entry["recorded"][0] for entry in manifest["cases"]] == recorded
    assert sorted(f"cases/{name}" for name in ran.names(kind, "cases")) == sorted(recorded)
    assert ran.names(kind, "journal") == []
    return {
        row["case"]: (
            row["outcome"],
            row["window"],
            hashlib.sha256(ran.read(kind, row["recorded"][0])).hexdigest(),
        )
        for row in rows
    }


@pytest.mark.parametrize("kind", REMOTE)
def test_the_manifest_can_be_put_only_once(ran: Ran, kind: str) -> None:
    before = ran.read(kind, "manifest.json")
    late = b'{"phase": "Failed", "driver": "one that was cut off and came back"}'
    assert not Storage({}).put_once(f"{ran.status[kind]['results']}/manifest.json", late)
    assert ran.read(kind, "manifest.json") == before
    assert len(json.loads(before)["driver"]) == 12


def test_no_credential_is_in_a_job_a_pod_a_log_a_status_or_a_result(ran: Ran) -> None:
    collected = ran.collected
    kinds = {json.loads(text)["kind"] for text in collected.objects}
    assert kinds == {"SimulationJob", "Pod", "ConfigMap", "Event"}
    for kind in KINDS:
        assert any(name.startswith(f"on-{kind}-1-driver") for name in collected.logs)
        assert any(name.startswith(f"on-{kind}-1-exec") for name in collected.logs)
        assert "cases planned" in collected.logs[f"on-{kind}-1-driver"]
    texts = {f"log of {name}": text for name, text in collected.logs.items()}
    texts |= {f"result {kind}/{name}": ran.read(kind, name).decode()
             for kind in KINDS for name in ("manifest.json", "results.jsonl")}  # fmt: skip
    texts["operator"] = k.kubectl("-n", "bagpipe-system", "logs", "deploy/bagpipe-operator")
    assert len(ran.hidden) == 3
    shown = [where for where, text in texts.items() if ran.shown(text)]
    assert shown + [json.loads(text)["metadata"]["name"] for text in collected.objects
                    if ran.shown(text)] == []  # fmt: skip


def test_the_stack_gets_no_credential(ran: Ran) -> None:
    pods = [json.loads(text) for text in ran.collected.objects if '"kind": "Pod"' in text]
    executors = [
        pod for pod in pods
        if pod["metadata"].get("labels", {}).get("sim.bagpipe.io/role") == "executor"
        and pod["metadata"]["labels"]["sim.bagpipe.io/job"] != "on-pvc"
    ]  # fmt: skip
    assert executors
    for pod in executors:
        given = {
            each["name"]: [source["secretRef"]["name"] for source in each.get("envFrom", [])]
            for each in (*pod["spec"]["initContainers"], *pod["spec"]["containers"])
        }
        login = pod["metadata"]["labels"]["sim.bagpipe.io/job"].removeprefix("on-") + "-login"
        assert given == {"agent": [], "stack": [], "spark": [login]}
