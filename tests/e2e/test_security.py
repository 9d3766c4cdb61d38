"""The walls around a running job, on a real kubelet, in a namespace that enforces `restricted`.

The rest of tests/e2e runs in that namespace too, so every example runs under it. What the API
server alone decides is in tests/integration/control_plane.
"""

import json
import subprocess
from collections.abc import Iterator

import pytest

from tests.e2e import jobs
from tests.e2e import kubectl as k

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("recordings")]

LIMITS = {"name": "limits", "configMap": {"name": "limits"}}


@pytest.fixture(scope="module")
def executor(namespace: str) -> Iterator[str]:
    """The name of an executor whose stack runs and has volumes and values of its own."""
    data = {"speed": "13.9"}
    config = {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": "limits"}, "data": data}
    k.kubectl("-n", namespace, "apply", "-f", "-", given=json.dumps(config))
    from_config = {"configMapKeyRef": {"name": "limits", "key": "speed"}}
    job = jobs.make_job(
        "walls",
        # Some five minutes, in which all tests look at it.
        playback={"mode": "realtime", "rate": 0.05},
        stack={
            "env": [{"name": "SPEED", "valueFrom": from_config}],
            "envFrom": [{"prefix": "LIMIT_", "configMapRef": {"name": "limits"}}],
            "volumeMounts": [{"name": "limits", "mountPath": "/opt/limits", "readOnly": True}],
        },
    )
    job["spec"]["spark"]["executor"] |= {
        "pod": {"volumes": [LIMITS], "labels": {"team": "lanes"}},
        "volumeMounts": [{"name": "limits", "mountPath": "/mnt/limits"}],
    }
    try:
        with jobs.applied(namespace, job) as name:

            def running() -> str | None:
                status = k.get(namespace, "simjob", name).get("status", {})
                if not status.get("cases", {}).get("running"):
                    return None
                pods = k.items(namespace, "pods", "-l", "sim.bagpipe.io/role=executor,team=lanes")
                return str(pods[0]["metadata"]["name"]) if pods else None

            yield k.await_that("a case to run", running, 300)
    finally:
        k.kubectl("-n", namespace, "delete", "configmap", "limits")


def inside(namespace: str, pod: str, container: str, script: str) -> str:
    """What a shell in a container prints, whatever its exit status."""
    words = [
        "-n",
        namespace,
        "exec",
        pod,
        "-c",
        container,
        "--",
        "sh",
        "-c",
        f"{script} 2>&1; true",
    ]
    return k.kubectl(*words).strip()


def test_the_stack_is_nobody_and_writes_only_where_it_should(namespace: str, executor: str) -> None:
    assert inside(namespace, executor, "stack", "id -u; id -g").split() == ["65532", "65532"]
    for path in ("/usr/bin/x", "/x", "/etc/x", "/bagpipe/volumes"):
        assert "Read-only file system" in inside(namespace, executor, "stack", f"mkdir {path}")
    for path in ("/tmp/x", "$HOME/x", "/bagpipe/shared/x"):
        assert inside(namespace, executor, "stack", f"echo a > {path} && rm {path}") == ""
    capabilities = inside(namespace, executor, "stack", "grep CapEff /proc/self/status")
    assert capabilities.split()[1] == "0000000000000000"
    assert "NoNewPrivs:\t1" in inside(namespace, executor, "stack", "cat /proc/self/status")


def test_the_stack_has_what_the_job_gave_it(namespace: str, executor: str) -> None:
    found = inside(
        namespace, executor, "stack", "echo $SPEED $LIMIT_speed $(cat /opt/limits/speed)"
    )
    assert found == "13.9 13.9 13.9"
    assert inside(namespace, executor, "spark", "cat /mnt/limits/speed") == "13.9"
    assert inside(namespace, executor, "spark", "echo $SPEED$LIMIT_speed") == ""


def test_the_stack_has_neither_a_token_nor_what_spark_authenticates_with(
    namespace: str, executor: str
) -> None:
    for container in ("stack", "spark"):
        listed = inside(namespace, executor, container, "ls /var/run/secrets/kubernetes.io")
        assert "No such file or directory" in listed
    assert "_SPARK_AUTH_SECRET" in inside(namespace, executor, "spark", "env")
    every = inside(namespace, executor, "stack", "cat /proc/[0-9]*/environ | tr '\\0' '\\n'")
    assert "HOME=/bagpipe/home" in every
    assert "SPARK" not in every
    # Nor does it see Spark's processes.
    assert "java" not in inside(namespace, executor, "stack", "cat /proc/[0-9]*/comm")


def test_spark_writes_only_where_it_should(namespace: str, executor: str) -> None:
    driver = k.get(namespace, "simjob", "walls")["status"]["driver"]
    for pod, container in ((executor, "spark"), (driver, "driver")):
        assert inside(namespace, pod, container, "id -u") == "10001"
        for path in ("/opt/bagpipe/lib/x", "/usr/x", "/etc/x"):
            assert "Read-only file system" in inside(namespace, pod, container, f"mkdir {path}")
    assert "Read-only file system" in inside(namespace, driver, "driver", "mkdir /etc/bagpipe/x")


def test_both_jvms_map_the_image_s_archive_of_classes(namespace: str, executor: str) -> None:
    driver = k.get(namespace, "simjob", "walls")["status"]["driver"]
    # Silently, a JVM leaves out an archive that does not fit its class path.
    look = "grep -l ' /opt/bagpipe/spark.jsa$' /proc/[0-9]*/maps | sed 's/maps/comm/' | xargs cat"
    for pod, container in ((executor, "spark"), (driver, "driver")):
        assert "java" in inside(namespace, pod, container, look).split()


def test_accounts_of_jobs_reach_nothing_else(namespace: str) -> None:
    def can(account: str, verb: str, what: str, where: str = namespace) -> str:
        kind, _, below = what.partition("/")  # kubectl takes pods/exec for a pod named exec
        asked = ["auth", "can-i", verb, kind, f"--subresource={below}", "-n", where]
        done = subprocess.run(
            ["kubectl", *asked, "--as", f"system:serviceaccount:{namespace}:{account}"],
            capture_output=True, text=True, timeout=120, check=False, env=k.tool_environment(),
        )  # fmt: skip
        return done.stdout.strip()

    assert can("bagpipe-driver", "create", "pods") == "yes"
    for verb, what in (("get", "secrets"), ("create", "pods/exec"), ("create", "rolebindings")):
        assert can("bagpipe-driver", verb, what) == "no"
    assert can("bagpipe-driver", "list", "pods", "default") == "no"
    assert can("bagpipe-driver", "list", "pods", "bagpipe-system") == "no"
    for verb, what in (("list", "pods"), ("get", "secrets"), ("get", "simulationjobs")):
        assert can("bagpipe-executor", verb, what) == "no"


def test_a_stack_that_wants_to_be_root_learns_who_refuses_it(namespace: str) -> None:
    job = jobs.make_job("root", stack={"securityContext": {"runAsNonRoot": False, "runAsUser": 0}})
    with jobs.applied(namespace, job) as name:

        def accepted() -> k.Object | None:
            found = k.get(namespace, "simjob", name).get("status", {}).get("conditions", [])
            return next((c for c in found if c["type"] == "Accepted"), None)

        found = k.await_that("a word about the job", accepted, 120)
        assert (found["status"], found["reason"]) == ("False", "CreationRefused")
        assert 'violates PodSecurity "restricted' in found["message"]
        pods = k.items(namespace, "pods", "-l", f"sim.bagpipe.io/job={name}")
        assert pods == []


def test_a_link_on_a_claim_does_not_lead_to_spark_s_environment(namespace: str) -> None:
    script = "mkdir -p /recordings/evil && ln -sfn /proc/self/environ /recordings/evil/evil.bag"
    k.in_toolbox(namespace, "sh", "-c", script)
    job = jobs.make_job("link", source={"bags": ["pvc://recordings/evil/evil.bag"]})
    with jobs.applied(namespace, job) as name:
        status = jobs.ended(namespace, name, 400)["status"]
    assert status["phase"] == "Failed"
    assert "a symbolic link leads out of the volume" in json.dumps(status)
