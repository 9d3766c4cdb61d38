"""A bad manifest is refused by the API server itself, with a sentence that says what to write.

Every case is one change to a good manifest, sent with --dry-run=server: nothing is kept.
"""

import copy
import json
import os
import subprocess
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

Manifest = dict[str, Any]

pytestmark = pytest.mark.e2e

CRD = Path(__file__).parents[2] / "crds" / "simulationjobs.yaml"
KUBECTL_SECONDS = 150

GOOD: Manifest = {
    "apiVersion": "sim.bagpipe.io/v1alpha1",
    "kind": "SimulationJob",
    "metadata": {"name": "good", "namespace": "default"},
    "spec": {
        "source": {"bags": ["pvc://recordings/drive.bag"]},
        "stack": {"image": "example/lane:1", "command": ["roslaunch", "lane", "lane.launch"]},
        "record": {"topics": ["/tf"]},
        "output": {"uri": "pvc://results/lane"},
    },
}


def kubectl(*words: str, given: str | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["kubectl", *words],
        input=given,
        capture_output=True,
        text=True,
        timeout=KUBECTL_SECONDS,
        check=False,
    )


def changed(path: str, value: object) -> Manifest:
    """GOOD with the value put at a path such as spec.source.bags."""
    manifest = copy.deepcopy(GOOD)
    *parents, last = path.split(".")
    place = manifest
    for name in parents:
        place = place.setdefault(name, {})
    place[last] = value
    return manifest


def without(path: str) -> Manifest:
    manifest = copy.deepcopy(GOOD)
    *parents, last = path.split(".")
    place = manifest
    for name in parents:
        place = place[name]
    del place[last]
    return manifest


@pytest.fixture(scope="module", autouse=True)
def crd() -> Iterator[None]:
    """The CRD as it is in this checkout; one that the chart installed is used as it is."""
    if not os.environ.get("KUBECONFIG"):
        pytest.fail("KUBECONFIG is not set: run `make cluster`, or set it to a cluster's")
    present = kubectl("get", "crd", "simulationjobs.sim.bagpipe.io").returncode == 0
    if not present:
        applied = kubectl("apply", "-f", str(CRD))
        assert applied.returncode == 0, applied.stderr
        waited = kubectl("wait", "--for=condition=Established", "--timeout=120s", "-f", str(CRD))
        assert waited.returncode == 0, waited.stderr
    yield
    if not present:  # the next module's look must not find it while it goes
        kubectl("delete", "--timeout=120s", "-f", str(CRD))


def dry_run(manifest: Manifest) -> subprocess.CompletedProcess[str]:
    return kubectl("create", "--dry-run=server", "-f", "-", given=json.dumps(manifest))


def test_a_good_manifest_is_taken() -> None:
    answer = dry_run(GOOD)
    assert (answer.returncode, answer.stderr) == (0, "")


GOOD_VARIATIONS = {
    "wildcards": ("spec.source.bags", ["pvc://recordings/2026-*/**/*.bag", "file:///mnt/x.bag"]),
    "an output beside the bags": ("spec.output.uri", "pvc://recordings/results"),
    "the root of a claim as output": ("spec.output.uri", "pvc://results/"),
    "a compound duration": ("spec.source.fragment", {"length": "1m30s", "warmUp": "500ms"}),
    "a whole number of CPUs": ("spec.spark.driver.resources", {"cpu": 1, "memory": "2Gi"}),
    "patterns to record": ("spec.record.topics", [".*", "(/tf|/tf_static)", "/lane/.*"]),
    "an integer rate": ("spec.playback.rate", 2),
    "a hundred rounds": ("spec.playback.rounds", 100),
    "lock-step": (
        "spec.playback",
        {"mode": "lockstep", "steps": [{"trigger": "/scan", "answer": "/out", "by": "stamp"}]},
    ),
    "any parameters": ("spec.stack.parameters", {"/a": 1.5, "/b": [1, "x"], "/c": {"d": True}}),
    "forty characters": ("metadata.name", "a" * 40),
    "criteria": (
        "spec.evaluate",
        [
            {"name": "never", "presence": {"topic": "/alarm", "min": 0, "max": 0}},
            {
                "name": "near",
                "error": {
                    "topic": "/a",
                    "fields": ["p[0].x"],
                    "recording": True,
                    "max": 1,
                    "stampTolerance": "1m30s",
                    "minCoverage": 0.5,
                },
            },
            {"name": "lane", "own": {"configMap": "lane", "timeout": "24h"}},
        ],
    ),
}


@pytest.mark.parametrize("case", GOOD_VARIATIONS)
def test_a_variation_is_taken(case: str) -> None:
    path, value = GOOD_VARIATIONS[case]
    answer = dry_run(changed(path, value))
    assert (answer.returncode, answer.stderr) == (0, "")


DURATION_HINT = "must be a duration above zero with its unit: write for example"
REFUSED: dict[str, tuple[str, object, str]] = {
    "rate 0": (
        "spec.playback.rate", 0,
        "playback.rate must be above 0: write 1.0 for real time",
    ),
    "negative rate": (
        "spec.playback.rate", -1.5,
        "playback.rate must be above 0: write 1.0 for real time",
    ),
    "rate above 100": (
        "spec.playback.rate", 100.5,
        "playback.rate must be at most 100: write mode: max to play as fast as the stack can",
    ),
    "no round at all": (
        "spec.playback.rounds", 0,
        "playback.rounds must be between 1 and 100: write how often each fragment is played",
    ),
    "unknown mode": (
        "spec.playback.mode", "fast",
        'spec.playback.mode: Unsupported value: "fast": supported values: "realtime", "max", "loc',
    ),
    "lock-step without steps": (
        "spec.playback", {"mode": "lockstep"},
        "playback.steps and playback.mode: lockstep belong together: write for example",
    ),
    "steps without lock-step": (
        "spec.playback", {"steps": [{"trigger": "/scan", "answer": "/out"}]},
        "playback.steps and playback.mode: lockstep belong together: write for example",
    ),
    "a step's deadline of nothing": (
        "spec.playback",
        {"mode": "lockstep", "steps": [{"trigger": "/a", "answer": "/b", "deadline": "0s"}]},
        "a deadline in playback.steps must be a duration above zero with its unit",
    ),
    "a trigger without slash": (
        "spec.playback", {"mode": "lockstep", "steps": [{"trigger": "scan", "answer": "/b"}]},
        "a trigger in playback.steps must begin with a slash: write for example /camera/image",
    ),
    "topic without slash": (
        "spec.source.topics", ["imu/data"],
        "a topic's name must begin with a slash: write for example /imu/data",
    ),
    "a slash is no topic": (
        "spec.source.topics", ["/"],
        "a topic's name must begin with a slash: write for example /imu/data",
    ),
    "topic twice": ("spec.source.topics", ["/a", "/a"], 'Duplicate value: "/a"'),
    "unknown scheme": (
        "spec.source.bags", ["ftp://fleet/drive.bag"],
        "this bag's URI has no known scheme: write pvc://<claim>/<path>, s3://<bucket>/<path>, ",
    ),
    "plain path": (
        "spec.source.bags", ["/data/drive.bag"],
        "this bag's URI has no known scheme: write pvc://<claim>/<path>, s3://<bucket>/<path>, ",
    ),
    "baseline outside its volume": (
        "spec.baseline", {"results": "pvc://results/../secrets/x"},
        "baseline.results leaves its volume: write it without '..'",
    ),
    "claim without path": (
        "spec.source.bags", ["pvc://recordings"],
        "this bag's URI has no known scheme: write pvc://<claim>/<path>, s3://<bucket>/<path>, ",
    ),
    "bag outside its volume": (
        "spec.source.bags", ["pvc://recordings/../secrets/x.bag"],
        "a bag's path must stay in its volume: write it without '..'",
    ),
    "no bags": (
        "spec.source.bags", [],
        'source.bags must name at least one bag: write for example ["pvc://recordings/drive.bag"]',
    ),
    "output of unknown scheme": (
        "spec.output.uri", "hdfs://results",
        "output.uri has no known scheme: write pvc://<claim>/<path>, s3://<bucket>/<path>, ",
    ),
    "output outside its volume": (
        "spec.output.uri", "pvc://results/a/../../b",
        "output.uri must stay in its volume: write it without '..'",
    ),
    "output with wildcard": (
        "spec.output.uri", "pvc://results/*",
        "output.uri must name one folder: write it without wildcards",
    ),
    "bag with a credential": (
        "spec.source.bags", ["s3://key:secret@fleet/drive.bag"],
        "put it into a Secret and write that Secret's name in storage.secrets",
    ),
    "bag with a signed query": (
        "spec.source.bags", ["https://fleet.example/drive.bag?X-Amz-Signature=1"],
        "put it into a Secret and write that Secret's name in storage.secrets",
    ),
    "wildcard on a web server": (
        "spec.source.bags", ["https://fleet.example/*.bag"],
        "write each bag's https:// URI without wildcards and without a query",
    ),
    "output with a credential": (
        "spec.output.uri", "s3://key:secret@fleet/results",
        "put it into a Secret and write that Secret's name in storage.secrets",
    ),
    "output on a web server": (
        "spec.output.uri", "https://fleet.example/results",
        "which can only be read from: write the URI of a volume, a bucket or HDFS",
    ),
    "name of a Secret": (
        "spec.storage.secrets", ["S3_Login"],
        "a Secret's name holds lower-case letters, digits, hyphens and dots",
    ),
    "output is a source": (
        "spec.output.uri", "pvc://recordings/drive.bag",
        "output.uri is equal to or below a bag of source.bags and would overwrite the recording",
    ),
    "output below a source": (
        "spec.output.uri", "pvc://recordings/drive.bag/results",
        "write a folder of its own, such as pvc://<claim>/results",
    ),
    "empty command": (
        "spec.stack.command", [],
        "stack.command is empty: write the command that starts the stack, word by word",
    ),
    "command of an empty word": (
        "spec.stack.command", [""],
        "stack.command is empty: write the command that starts the stack, word by word",
    ),
    "empty image": (
        "spec.stack.image", "",
        "stack.image must name a container image: write for example registry.example/lane:1.4",
    ),
    "unknown pull policy": (
        "spec.stack.imagePullPolicy", "Sometimes",
        'supported values: "Always", "IfNotPresent", "Never"',
    ),
    "remap without slash": (
        "spec.stack.remap", {"image": "/camera/image"},
        "stack.remap maps names that begin with a slash on both sides",
    ),
    "remap to a name without slash": (
        "spec.stack.remap", {"/image": "camera/image"},
        "stack.remap maps names that begin with a slash on both sides",
    ),
    "env name": (
        "spec.stack.env", [{"name": "2ND", "value": "x"}],
        "this is no environment variable's name: write for example ROS_LOG_DIR",
    ),
    "env twice": (
        "spec.stack.env", [{"name": "A", "value": "1"}, {"name": "A", "value": "2"}],
        'spec.stack.env[1]: Duplicate value: {"name":"A"}',
    ),
    "parameters as a list": ("spec.stack.parameters", ["/a"], "must be of type object"),
    "memory of the stack": (
        "spec.stack.resources", {"limits": {"memory": "2 GB"}},
        "this is no quantity: write for example 2 or 500m of cpu, 2Gi or 500Mi of memory",
    ),
    "cpu of the stack": (
        "spec.stack.resources", {"requests": {"cpu": "two"}},
        "this is no quantity: write for example 2 or 500m of cpu, 2Gi or 500Mi of memory",
    ),
    "no recorded topics": (
        "spec.record.topics", [],
        "record.topics must name at least one topic: write for example [/tf,",
    ),
    "recorded topic without slash": (
        "spec.record.topics", ["lane/.*"],
        "a recorded topic begins with a slash: write /name, or a pattern such as /lane/.*",
    ),
    "duration without unit": (
        "spec.source.fragment.length", "20", f"source.fragment.length {DURATION_HINT}",
    ),
    "duration in days": (
        "spec.source.fragment.length", "1d", f"source.fragment.length {DURATION_HINT}",
    ),
    "duration of zero": (
        "spec.source.fragment.length", "0s", f"source.fragment.length {DURATION_HINT}",
    ),
    "warm-up without unit": (
        "spec.source.fragment.warmUp", "two",
        "source.fragment.warmUp must be a duration with its unit: write for example 2s or 500ms",
    ),
    "timeout of zero": (
        "spec.playback.subscribeTimeout", "0s", f"playback.subscribeTimeout {DURATION_HINT}",
    ),
    "negative timeout": (
        "spec.playback.caseTimeout", "-5s", f"playback.caseTimeout {DURATION_HINT}",
    ),
    "no executors": (
        "spec.spark.executors", 0,
        "spark.executors must be between 1 and 1000: write how many executor pods the job gets",
    ),
    "too many slots": (
        "spec.spark.slots", 65,
        "spark.slots must be between 1 and 64: write how many cases one executor runs at a time",
    ),
    "memory below Spark's": (
        "spec.spark.executor.resources.memory", "256Mi",
        "must be a quantity of at least 896Mi, 512Mi of it for Spark's JVM: write for example 1Gi",
    ),
    "memory in an unknown unit": (
        "spec.spark.driver.resources.memory", "1e10",
        "spark.driver.resources.memory must be a quantity of at least 896Mi",
    ),
    "cpu of the driver": (
        "spec.spark.driver.resources.cpu", "0",
        "spark.driver.resources.cpu must be a quantity of CPU above zero: write for example 500m",
    ),
    "latency without a unit": (
        "spec.evaluate", [{"name": "a", "latency": {"topic": "/a", "max": "100"}}],
        "latency.max must be a duration with its unit: write for example 100ms or 2s",
    ),
    "criterion's topic without slash": (
        "spec.evaluate", [{"name": "a", "presence": {"topic": "imu"}}],
        "this is no topic's name: write for example /imu/data",
    ),
    "presence with a max alone": (
        "spec.evaluate", [{"name": "a", "presence": {"topic": "/a", "max": 0}}],
        "presence has a max below its min: write min: 0 as well",
    ),
    "bounds the wrong way round": (
        "spec.evaluate",
        [{"name": "a", "bounds": {"topic": "/a", "field": "x", "min": 2, "max": 1}}],
        "bounds has a max below its min: write the greater one as max",
    ),
    "field that is no path": (
        "spec.evaluate", [{"name": "a", "bounds": {"topic": "/a", "field": "x..y", "max": 1}}],
        "a field is a path of names, with an element's number in brackets",
    ),
    "fewer fields in the truth": (
        "spec.evaluate",
        [{"name": "a", "error": {"topic": "/a", "truth": "/b", "max": 1,
                                 "fields": ["x", "y"], "truthFields": ["x"]}}],
        "error.truthFields and fields differ in number: write one for each field, or none",
    ),
    "more than all of it covered": (
        "spec.evaluate",
        [{"name": "a", "rate": {"topic": "/a", "min": 1, "minCoverage": 1.5}}],
        "should be less than or equal to 1",
    ),
    "memory of a criterion": (
        "spec.evaluate", [{"name": "a", "resources": {"maxMemory": "2 GB"}}],
        "resources.maxMemory is no quantity: write for example 500Mi or 2Gi",
    ),
    "an evaluator that never has time": (
        "spec.evaluate", [{"name": "a", "own": {"configMap": "lane", "timeout": "0s"}}],
        "own.timeout must be a duration above zero and of at most 24h",
    ),
    "unknown field": (
        "spec.playback.speed", 2, 'unknown field "spec.playback.speed"',
    ),
    "long name": (
        "metadata.name", "a" * 41,
        "metadata.name must have at most 40 characters, since the names of the job's pods",
    ),
    "dotted name": (
        "metadata.name", "lane.1.4",
        ("lower-case letters, digits and hyphens, since pod names are built from it: write for "
        "example lane-keeping-1-4"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_a_bad_manifest_is_refused_with_what_to_write(case: str) -> None:
    path, value, sentence = REFUSED[case]
    answer = dry_run(changed(path, value))
    assert answer.returncode == 1
    assert sentence in answer.stderr


def test_an_output_below_a_double_wildcard_is_refused() -> None:
    manifest = changed("spec.source.bags", ["pvc://data/**/*.bag"])
    manifest["spec"]["output"]["uri"] = "pvc://data/results"
    answer = dry_run(manifest)
    assert answer.returncode == 1
    assert "output.uri lies below a ** of source.bags" in answer.stderr


@pytest.mark.parametrize("field", ["source", "stack", "output"])
def test_a_required_part_is_named(field: str) -> None:
    answer = dry_run(without(f"spec.{field}"))
    assert answer.returncode == 1
    assert f"spec.{field}: Required value" in answer.stderr


CHANGES = {
    "another image": {"stack": {"image": "example/lane:2"}},
    "another value of a parameter": {"stack": {"parameters": {"/threshold": 0.6}}},
    "a nested value of a parameter": {"stack": {"parameters": {"/gains": {"p": 2}}}},
    "one more parameter": {"stack": {"parameters": {"/more": True}}},
    "more executors": {"spark": {"executors": 4}},
}


@pytest.fixture(scope="module")
def kept() -> Iterator[str]:
    """The namespace of a job `kept`, which no operator need watch."""
    manifest = changed("spec.stack.parameters", {"/threshold": 0.5, "/gains": {"p": 1}})
    # Its own, since that of an earlier run may still be going.
    namespace = f"crd-refusals-{uuid.uuid4().hex[:6]}"
    manifest["metadata"] = {"name": "kept", "namespace": namespace}
    created = kubectl("create", "namespace", namespace)
    assert created.returncode == 0, created.stderr
    made = kubectl("apply", "-f", "-", given=json.dumps(manifest))
    assert made.returncode == 0, made.stderr
    yield namespace
    kubectl("delete", "namespace", namespace, "--wait=false")


@pytest.mark.parametrize("case", CHANGES)
def test_the_spec_of_a_job_can_not_be_changed(kept: str, case: str) -> None:
    patch = json.dumps({"spec": CHANGES[case]})
    answer = kubectl("patch", "simjob", "kept", "-n", kept, "--type=merge", "-p", patch)
    assert answer.returncode == 1
    assert (
        "can be changed once the job exists, and spec.spark while it is suspended, since its cases "
        "are already planned: delete the job, or create one with another name" in answer.stderr
    )


def test_kubectl_explains_a_field() -> None:
    shown = kubectl("explain", "simjob.spec.stack.remap")
    assert shown.returncode == 0, shown.stderr
    assert "The player publishes the recorded topic" in shown.stdout
