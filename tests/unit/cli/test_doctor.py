"""`bagpipe doctor`: what each answer of an API server, and each look at a machine, comes to."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.cli.doctor import in_namespace
from bagpipe.cli.health import cluster
from bagpipe.cli.health.finding import Finding, status_of
from bagpipe.cli.health.machine import Seen, free_memory, java_version, of_machine
from bagpipe.cli.health.needs import Needs, needs_of
from bagpipe.cli.health.replies import Answer
from bagpipe.spec import SimulationJobSpec

FORBIDDEN = Answer(403, {}, "forbidden")
MISSING = Answer(404, {}, "not found")
SILENT = Answer(0, {}, "timed out")
SPEC: dict[str, Any] = {
    "source": {"bags": ["pvc://recordings/a.bag"]},
    "stack": {"image": "i", "command": ["c"]},
    "record": {"topics": ["/tf"]},
    "output": {"uri": "pvc://results/a"},
}


def spec(**changed: Any) -> SimulationJobSpec:
    return SimulationJobSpec.model_validate(SPEC | changed)


def listed(*items: dict[str, Any]) -> Answer:
    return Answer(200, {"items": list(items)})


def state(found: Finding) -> str:
    return found.state


@pytest.mark.parametrize(
    ("answer", "expected", "words"),
    [
        (Answer(200, {"gitVersion": "v1.34.1"}), "done", "v1.34.1 at context lab"),
        (Answer(200, {"gitVersion": "v1.29.0-eks-1"}), "done", "v1.29.0-eks-1"),
        (Answer(200, {"gitVersion": "v1.28.9"}), "missing", "knows no native sidecars"),
        (Answer(200, {"gitVersion": "\x1b[31m"}), "unknown", "its version is '\\x1b[31m'"),
        (Answer(200, {}), "unknown", "what answers for context lab is no API server"),
        (Answer(200, {"gitVersion": ["v1.34.1"]}), "unknown", "lab is no API server"),
        (SILENT, "unknown", "context lab does not answer: timed out"),
        (Answer(401, {}, "Unauthorized"), "unknown", "does not know you"),
    ],
)
def test_the_version(answer: Answer, expected: str, words: str) -> None:
    found = cluster.of_version(answer, "lab")
    assert (found.state, words in found.found) == (expected, True), found


def test_what_may_not_be_read_is_unknown_with_the_words_that_help() -> None:
    answers = dict.fromkeys(("bagpipe-driver", "bagpipe-executor"), FORBIDDEN)
    found = [
        cluster.of_kinds(FORBIDDEN),
        cluster.of_schema(FORBIDDEN, ["source"]),
        cluster.of_operator(FORBIDDEN, FORBIDDEN, "home"),
        *cluster.of_namespace(FORBIDDEN, "robots", None),
        cluster.of_right(FORBIDDEN, "create", "robots"),
        *cluster.of_accounts(answers, "robots"),
        *cluster.of_quota(FORBIDDEN, None),
        cluster.of_policies(FORBIDDEN),
        cluster.of_object("job", "Secret", "s", FORBIDDEN),
        cluster.of_claim("c", FORBIDDEN),
        cluster.of_dry_run(FORBIDDEN, []),
    ]
    for each in found:
        assert each.state == "unknown", each
        assert each.found.startswith("you may not read"), each
        assert each.remedy
    assert status_of(found, reached=True) == 0


def test_an_answer_that_does_not_come_is_unknown_too() -> None:
    for each in (cluster.of_kinds(SILENT), cluster.of_claim("c", SILENT)):
        assert (each.state, each.found) == ("unknown", "no answer: timed out")
    broken = cluster.of_kinds(Answer(500, {}, "etcd is gone"))
    assert (broken.state, "500: etcd is gone" in broken.found) == ("unknown", True)


def test_the_kinds_and_their_schema() -> None:
    assert cluster.of_kinds(MISSING).state == "missing"
    served = [{"kind": "SimulationJob"}, {"kind": "SimulationSchedule"}, "odd"]
    assert cluster.of_kinds(Answer(200, {"resources": served})).state == "done"
    half = cluster.of_kinds(Answer(200, {"resources": served[:1]}))
    assert (half.state, half.found) == ("missing", "SimulationSchedule is not served")


@pytest.mark.parametrize(
    ("fields", "expected", "words"),
    [
        (["source", "stack"], "done", "all 2 fields"),
        (["source"], "missing", "lack spec.stack: the CRD is older"),
        (["source", "stack", "x"], "missing", "have spec.x: the CRD is newer"),
    ],
)
def test_a_schema_of_another_release(fields: list[str], expected: str, words: str) -> None:
    known: dict[str, Any] = {name: {} for name in fields}
    job = {"properties": {"spec": {"properties": known}}}
    document = {"components": {"schemas": {"io.bagpipe.sim.v1alpha1.SimulationJob": job}}}
    found = cluster.of_schema(Answer(200, document), ["source", "stack"])
    assert (found.state, words in found.found) == (expected, True), found


@pytest.mark.parametrize("document", [{}, {"components": {"schemas": []}}])
def test_a_document_without_a_schema_is_unknown(document: Any) -> None:
    assert cluster.of_schema(Answer(200, document), ["source"]).state == "unknown"


def deployment(ready: int) -> dict[str, Any]:
    labels = {"app.kubernetes.io/version": "0.1.0"}
    return {
        "metadata": {"name": "op", "labels": labels},
        "spec": {"replicas": 2},
        "status": {"readyReplicas": ready},
    }


def test_the_operator() -> None:
    found = cluster.of_operator(listed(deployment(1)), FORBIDDEN, "home")
    assert (found.state, found.found) == ("done", "home/op 0.1.0 is ready")
    found = cluster.of_operator(listed(deployment(0)), FORBIDDEN, "home")
    assert (found.state, found.found) == ("missing", "none of 2 pods of home/op is ready")
    assert cluster.of_operator(listed(), listed(), "home").state == "unknown"
    job = {"metadata": {"name": "lane"}, "status": {"conditions": [{}]}}
    found = cluster.of_operator(FORBIDDEN, listed({"metadata": {}}, job), "home")
    # That one was there once is no sign that it is there now.
    assert (found.state, "the status of job lane" in found.found) == ("unknown", True)


@pytest.mark.parametrize(
    ("level", "loosens", "expected"),
    [
        ("restricted", [], ["done", "done"]),
        ("restricted", ["runAsUser: 0"], ["done", "missing"]),
        ("baseline", ["runAsUser: 0"], ["done", "done"]),
        ("", ["runAsUser: 0"], ["done", "done"]),
    ],
)
def test_pod_security(level: str, loosens: list[str], expected: list[str]) -> None:
    labels = {"pod-security.kubernetes.io/enforce": level} if level else {}
    answer = Answer(200, {"metadata": {"labels": labels}})
    found = cluster.of_namespace(answer, "robots", Needs(loosens=loosens))
    assert list(map(state, found)) == expected


def test_a_namespace_that_is_not_there_or_goes() -> None:
    assert list(map(state, cluster.of_namespace(MISSING, "robots", None))) == ["missing"]
    going = Answer(200, {"metadata": {"deletionTimestamp": "now"}})
    assert list(map(state, cluster.of_namespace(going, "robots", None))) == ["missing"]


def test_rights_and_accounts() -> None:
    allowed = Answer(201, {"status": {"allowed": True}})
    assert cluster.of_right(allowed, "create", "robots").state == "done"
    assert cluster.of_right(Answer(201, {"status": {}}), "create", "robots").state == "missing"
    answers = {
        "bagpipe-driver": Answer(200, {"imagePullSecrets": [{"name": "b"}, {}, 3]}),
        "bagpipe-executor": MISSING,
    }
    assert list(map(state, cluster.of_accounts(answers, "robots"))) == ["done", "missing"]
    assert cluster.pull_secrets_of(answers) == ["b"]


def quota(hard: dict[str, str], used: dict[str, str] | None = None) -> dict[str, Any]:
    return {"metadata": {"name": "q"}, "status": {"hard": hard, "used": used or {}}}


@pytest.mark.parametrize(
    ("hard", "used", "expected", "words"),
    [
        ({"pods": "3"}, {"pods": "0"}, "done", "there is room"),
        ({"pods": "2"}, {}, "missing", "needs 3 of pods, of which it gives 2"),
        ({"pods": "3"}, {"pods": "1"}, "unknown", "1 of 3 are taken"),
        ({"requests.memory": "2Gi"}, {}, "missing", "needs 3Gi of requests.memory"),
        ({"requests.cpu": "1500m"}, {}, "done", "there is room"),
        ({"limits.cpu": "100"}, {}, "missing", "it has limits.cpu"),
        ({"pods": "many"}, {"pods": "-"}, "done", "there is room"),
    ],
)
def test_the_quota(hard: dict[str, str], used: dict[str, str], expected: str, words: str) -> None:
    needs = needs_of(spec(spark={"executors": 2}))
    (found,) = cluster.of_quota(listed(quota(hard, used)), needs)
    assert (found.state, words in found.found) == (expected, True), found


def test_the_quota_of_executors_that_come_and_go_has_room_for_all_of_them() -> None:
    breathing = needs_of(spec(spark={"executors": {"min": 1, "max": 2}}))
    assert breathing == needs_of(spec(spark={"executors": 2}))


def test_of_several_quotas_those_that_lack_are_shown() -> None:
    needs = needs_of(spec())
    answer = listed(quota({"pods": "9"}), quota({"pods": "1"}), quota({"requests.cpu": "1m"}))
    assert list(map(state, cluster.of_quota(answer, needs))) == ["missing", "missing"]
    assert list(map(state, cluster.of_quota(answer, None))) == ["done"]
    assert list(map(state, cluster.of_quota(listed(), needs))) == ["done"]


def policy(name: str, labels: dict[str, str], *types: str, ingress: Any = None) -> dict[str, Any]:
    body = {"podSelector": {"matchLabels": labels}, "policyTypes": list(types), "ingress": ingress}
    return {"metadata": {"name": name}, "spec": body}


OURS = [
    policy(f"bagpipe-{role}", {"sim.bagpipe.io/role": role}, "Ingress", ingress=[{}])
    for role in ("driver", "executor")
]


def test_network_policies() -> None:
    closed = policy("deny-all", {}, "Ingress")
    assert cluster.of_policies(listed()).state == "done"
    assert cluster.of_policies(listed(*OURS)).state == "done"
    found = cluster.of_policies(listed(closed))
    assert (found.state, "deny-all closes drivers" in found.found) == ("missing", True)
    assert cluster.of_policies(listed(closed, *OURS[:1])).state == "missing"
    assert cluster.of_policies(listed(closed, *OURS)).state == "done"
    assert cluster.of_policies(listed(policy("a", {"app": "b"}, "Ingress"))).state == "done"
    leaving = cluster.of_policies(listed(*OURS, policy("out", {}, "Egress")))
    assert (leaving.state, "out decides what" in leaving.found) == ("unknown", True)


@pytest.mark.parametrize(
    ("phase", "expected"),
    [("Bound", "done"), ("Pending", "unknown"), ("Lost", "missing"), (None, "unknown")],
)
def test_a_claim(phase: str | None, expected: str) -> None:
    assert cluster.of_claim("c", Answer(200, {"status": {"phase": phase}})).state == expected
    assert cluster.of_claim("c", MISSING).state == "missing"


def test_what_the_api_server_says_of_the_job() -> None:
    assert cluster.of_dry_run(Answer(201), []).state == "done"
    refused = cluster.of_dry_run(Answer(422), ["spec.a: write b", "spec.c: write d"])
    assert (refused.state, refused.found) == ("missing", "spec.a: write b; spec.c: write d")
    assert cluster.of_dry_run(Answer(409), []).state == "missing"
    assert cluster.of_object("job", "Secret", "s", Answer(200)).state == "done"
    assert cluster.of_object("job", "Secret", "s", MISSING).state == "missing"


def test_what_a_job_needs() -> None:
    key = {"name": "licence", "key": "k"}
    pod = {
        "priorityClassName": "nightly",
        "imagePullSecrets": [{"name": "registry"}],
        "volumes": [
            {"name": "models", "persistentVolumeClaim": {"claimName": "models"}},
            {"name": "maps", "configMap": {"name": "maps"}},
            {"name": "spare", "secret": {"secretName": "spare", "optional": True}},
            {"name": "both", "projected": {"sources": [{"secret": {"name": "inner"}}]}},
        ],
    }
    stack = {
        "image": "i",
        "command": ["c"],
        "env": [{"name": "A", "valueFrom": {"secretKeyRef": key}}],
        "envFrom": [
            {"configMapRef": {"name": "settings"}},
            {"secretRef": {"name": "may-lack", "optional": True}},
        ],
        "resources": {"requests": {"cpu": "2"}, "limits": {"memory": "3Gi"}},
        "securityContext": {"runAsNonRoot": False, "runAsUser": 0},
    }
    found = needs_of(
        spec(
            stack=stack,
            spark={"executors": 3, "executor": {"pod": pod}},
            variants=[{"name": "a"}, {"name": "b", "image": "j"}],
            storage={"secrets": ["fleet"]},
        )
    )
    assert found.claims == ["models", "recordings", "results"]
    assert found.secrets == ["fleet", "inner", "licence", "registry"]
    assert found.config_maps == ["maps", "settings"]
    assert found.priorities == ["nightly"]
    assert found.loosens == ["runAsUser: 0", "runAsNonRoot: false"]
    assert found.amounts["pods"] == 4
    # Two images in each of three executors, and a driver.
    assert found.amounts["requests.cpu"] == 0.5 + 3 * (0.5 + 2 * 2)
    assert found.amounts["requests.memory"] == 2**30 * (1 + 3 * (1 + 2 * 3))
    assert found.amounts["limits.memory"] == found.amounts["requests.memory"]


HERE = Seen("/k", "", "/a", 17, True, 8 << 30, 4, {"ros1": "/r", "ros2": ""})


def states(seen: Seen, wanted: str, job: SimulationJobSpec | None = None) -> dict[str, str]:
    return {
        f.what: f"{f.state}{' optional' if f.optional and f.state != 'done' else ''}"
        for f in of_machine(seen, job, wanted)
    }


def test_a_whole_machine() -> None:
    found = states(HERE, "spark")
    assert found.pop("ROS 2") == "missing optional"
    assert set(found.values()) == {"done"}


def test_a_bare_machine_submits_and_runs_nothing() -> None:
    bare = Seen(None, "it is missing", None, None, False, None, 1, {"ros1": "", "ros2": ""})
    assert status_of(of_machine(bare, None, "submit"), reached=True) == 0
    found = states(bare, "run")
    assert {what for what, each in found.items() if each == "missing"} == {
        "native module", "bagpipe-agent", "ROS 1", "ROS 2",
    }  # fmt: skip
    assert found["memory"] == "unknown"
    assert {states(bare, "spark")[what] for what in ("Java", "PySpark")} == {"missing"}
    assert status_of(of_machine(bare, None, "run"), reached=True) == 1


def test_the_engine_of_a_job_decides_which_ros_is_needed() -> None:
    ros2 = spec(stack=SPEC["stack"] | {"engine": "ros2"})
    assert states(HERE, "run", ros2)["ROS 2"] == "missing"
    assert "ROS 1" not in states(HERE, "run", ros2)
    exec_job = spec(stack=SPEC["stack"] | {"engine": "exec"}, record=None)
    assert not {"ROS 1", "ROS 2"} & states(HERE, "run", exec_job).keys()


def test_memory_by_the_slots_that_run_at_once() -> None:
    stack = SPEC["stack"] | {"resources": {"limits": {"memory": "4Gi"}}}
    wide = spec(stack=stack, spark={"executors": 8, "slots": 2})
    (found,) = [f for f in of_machine(HERE, wide, "run") if f.what == "memory"]
    # Four slots on four processors, of 2 GiB and 256 MiB each.
    assert found.found == "8 GiB are free; 4 slots may take 9 GiB"
    assert found.state == "missing"
    roomy = replace(HERE, memory=9 << 30)
    assert states(roomy, "run", wide)["memory"] == "done"


def test_old_java() -> None:
    assert states(replace(HERE, java=11), "spark")["Java"] == "missing"
    assert java_version('openjdk version "17.0.2" 2022-01-18') == 17
    assert java_version('java version "1.8.0_301"') == 8
    assert java_version("nonsense") is None


def test_memory_is_what_is_free_within_the_cgroup() -> None:
    text = "MemTotal:       100 kB\nMemAvailable:   2048 kB\n"
    assert free_memory(text, "max\n") == 2 << 20
    assert free_memory(text, "1048576\n") == 1 << 20
    assert free_memory("", "") is None


def test_a_status_for_each_end() -> None:
    lacks = Finding("job", "a", "missing", "b")
    assert status_of([lacks], reached=False) == 1
    assert status_of([replace(lacks, optional=True)], reached=True) == 0
    assert status_of([], reached=False) == 2


def doctor(*words: str, **environment: str) -> Any:
    return CliRunner(env=environment).invoke(main, ["doctor", *words])


def test_without_a_kubeconfig_that_is_what_is_missing(tmp_path: Path) -> None:
    done = doctor("--output", "json", KUBECONFIG=str(tmp_path / "none"))
    assert done.exit_code == 1
    (found,) = [each for each in json.loads(done.stdout) if each["part"] == "cluster"]
    assert (found["what"], found["state"]) == ("kubeconfig", "missing")


@pytest.mark.parametrize(
    ("name", "path"),
    [
        ("robots", "/api/namespaces/robots"),
        ("a/pods?watch=1&x=", "/api/namespaces/a%2Fpods%3Fwatch%3D1%26x%3D"),
        ("..", "/api/namespaces/%2E%2E"),
        ("a#b", "/api/namespaces/a%23b"),
    ],
)
def test_a_name_changes_no_other_part_of_a_path(name: str, path: str) -> None:
    assert in_namespace("/api", name) == path


def test_a_manifest_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "job.yaml").write_text("kind: ConfigMap\n")
    done = doctor(str(tmp_path / "job.yaml"), "--for", "run")
    assert (done.exit_code, "holds 0 SimulationJobs" in done.stderr) == (2, True)


def test_a_table_of_one_line_for_each(tmp_path: Path) -> None:
    job: dict[str, Any] = {"apiVersion": "sim.bagpipe.io/v1alpha1", "kind": "SimulationJob"}
    job |= {"metadata": {"name": "lane"}, "spec": SPEC}
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(job))
    words = (str(tmp_path / "job.yaml"), "--for", "run", "--agent", "no-such-agent")
    done = doctor(*words, COLUMNS="200")
    assert done.exit_code == 1
    lines = [line.split() for line in done.stdout.splitlines()]
    assert lines[0][:3] == ["Of", "What", "State"]
    assert ["machine", "bagpipe-agent", "missing"] in [line[:3] for line in lines]
