"""The verbs that talk to a cluster, against a real API server; statuses are the operator's words.

No operator runs here: a test patches a job's status as the operator would.
"""

import json
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.cli.kubectl import proposals
from tests.integration.control_plane.cli_process import CliProcess
from tests.integration.control_plane.client import Client, Object, core, jobs
from tests.integration.control_plane.observe import a_job, await_right
from tests.integration.control_plane.release import fresh_namespace
from tests.integration.control_plane.server import CRDS, ControlPlane, install_crd
from tests.unit.bagpipe.jobs import make_row
from tests.unit.cli import pipeline
from tests.unit.cli.cluster_objects import condition
from tests.unit.report.publishing import publish
from tests.waiting import wait_until

WAIT_SECONDS = 90.0
PROGRAM = f'exec {sys.executable} -m bagpipe.cli "$@"'
RUNNING = [
    condition("Accepted", True, "DriverCreated"),
    condition("Running", True, "CasesRunning", "Cases are running."),
]


@dataclass(frozen=True)
class Ended:
    """How a run of the program ended."""

    status: int
    stdout: str
    stderr: str

    @property
    def text(self) -> str:
        return self.stdout + self.stderr


Program = Callable[..., Ended]


def run(kubeconfig: Path, *words: str, given: str | None = None) -> Ended:
    done = CliRunner(env={"KUBECONFIG": str(kubeconfig)}).invoke(main, list(words), input=given)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return Ended(done.exit_code, done.stdout, done.stderr)


@pytest.fixture
def program(control_plane: ControlPlane, namespace: str) -> Program:
    """The program in a namespace of its own, as the administrator."""

    def called(*words: str, given: str | None = None) -> Ended:
        return run(control_plane.kubeconfig, *words, "-n", namespace, given=given)

    return called


@pytest.fixture
def later() -> Iterator[ThreadPoolExecutor]:
    """Runs the program beside the test."""
    with ThreadPoolExecutor(1) as pool:
        yield pool


def manifest(name: str = "lane", **spec: Any) -> Object:
    job = a_job(name)
    job["spec"] = job["spec"] | spec
    return {"apiVersion": "sim.bagpipe.io/v1alpha1", "kind": "SimulationJob"} | job


def report(
    admin: Client, namespace: str, name: str, conditions: list[Object], **status: Any
) -> None:
    """What the operator would write."""
    moment = {"lastTransitionTime": "2026-11-20T04:00:00Z"}
    reported = {"conditions": [c | moment for c in conditions]} | status
    admin.merge(jobs(namespace, name) + "/status", {"status": reported})


def report_end(admin: Client, namespace: str, name: str, verdict: str, **status: Any) -> None:
    kind = "Complete" if verdict else "Failed"
    ended = condition(
        kind, True, "AllCasesRan" if verdict else "StackImageUnavailable", "It ended."
    )
    cases = {"planned": 4, "passed": 4}
    judged = {"verdict": verdict} if verdict else {}
    report(admin, namespace, name, [ended], phase=kind, cases=cases, **judged, **status)


def test_submit_creates_the_job_and_says_what_to_do_next(
    program: Program, admin: Client, namespace: str, tmp_path: Path
) -> None:
    (tmp_path / "job.yaml").write_text(
        yaml.safe_dump_all([{"kind": "ConfigMap"}, manifest("lane")])
    )
    done = program("submit", str(tmp_path / "job.yaml"))
    assert done.status == 0
    assert f"job lane is created in namespace {namespace}" in done.stdout
    assert f"watch lane -n {namespace}" in done.stdout
    assert "1 other objects of" in done.stderr
    assert admin.get(jobs(namespace, "lane"))["spec"]["source"] == manifest()["spec"]["source"] | {
        "fragment": {"length": "60s", "warmUp": "0s"}
    }
    assert "lane is there already" in program("submit", str(tmp_path / "job.yaml")).stderr


def test_names_are_given_or_made(program: Program, admin: Client, namespace: str) -> None:
    given = json.dumps(manifest("lane"))
    made = program("submit", "-", "--generate-name", "--output", "json", given=given)
    name = json.loads(made.stdout)["metadata"]["name"]
    assert (made.status, name[:5], len(name)) == (0, "lane-", 10)
    assert program("submit", "-", "--name", "other", given=given).status == 0
    names = {o["metadata"]["name"] for o in admin.items(jobs(namespace))}
    assert names == {name, "other"}


def test_a_dry_run_is_judged_and_not_kept(program: Program, admin: Client, namespace: str) -> None:
    done = program(
        "submit", "-", "--dry-run", "--output", "yaml", given=json.dumps(manifest("lane"))
    )
    assert (done.status, yaml.safe_load(done.stdout)["metadata"]["name"]) == (0, "lane")
    assert "nothing is kept" in done.stderr
    assert admin.items(jobs(namespace)) == []


@pytest.mark.parametrize(
    ("changed", "sentences"),
    [
        ({"source": {}}, ["  spec.source: source needs one of bags, sequence, files"]),
        (
            {"source": {"bags": ["drive.bag"]}},
            ["  spec.source.bags[0]: this bag's URI has no known scheme: write pvc://<claim>/"],
        ),
        ({"sourc": {}}, ["  spec.sourc: there is no such field"]),
        ({"stack": {"image": "i"}}, ["  spec.stack.command: Required value"]),
    ],
)
def test_a_refused_job_is_reported_in_sentences(
    program: Program, admin: Client, namespace: str, changed: Object, sentences: list[str]
) -> None:
    done = program("submit", "-", "--wait", given=json.dumps(manifest("lane", **changed)))
    assert done.status == 2
    assert "Error: job lane is refused:" in done.stderr
    for sentence in sentences:
        assert sentence in done.stderr
    assert "Invalid value" not in done.stderr
    assert admin.items(jobs(namespace)) == []


@pytest.mark.parametrize(
    ("verdict", "status"), [("Passed", 0), ("Failed", 1), ("Invalid", 1), ("", 2)]
)
def test_submit_waits_and_ends_with_the_verdict(
    program: Program, admin: Client, namespace: str, later: ThreadPoolExecutor,
    verdict: str, status: int,
) -> None:  # fmt: skip
    given = json.dumps(manifest("lane"))
    words = ("submit", "-", "--wait", "--timeout", "300s", "--output", "json")
    done = later.submit(program, *words, given=given)
    wait_until(lambda: admin.exists(jobs(namespace, "lane")), WAIT_SECONDS, "no job was made")
    report(admin, namespace, "lane", RUNNING, phase="Running", cases={"planned": 4, "passed": 1})
    report_end(admin, namespace, "lane", verdict)
    ended = done.result(WAIT_SECONDS)
    found = json.loads(ended.stdout)
    assert (ended.status, found["verdict"], found["cases"]["passed"]) == (status, verdict, 4)
    assert "job lane is created" in ended.stderr


def test_watch_follows_a_job_through_trouble_to_its_end(
    control_plane: ControlPlane, admin: Client, namespace: str
) -> None:
    admin.create(jobs(namespace), a_job("lane"))
    stuck = condition("Running", False, "VolumeMissing", "The claim drives does not exist.")
    report(admin, namespace, "lane", [stuck], phase="Pending")
    words = ("watch", "lane", "-n", namespace, "--timeout", "300s")
    with CliProcess(control_plane.kubeconfig, *words) as watch:
        watch.read_until(" Pending; VolumeMissing: The claim drives does not exist.")
        report(
            admin, namespace, "lane", RUNNING, phase="Running", cases={"planned": 4, "passed": 2}
        )
        watch.read_until(" Running; 2 of 4 cases: 2 passed")
        report_end(admin, namespace, "lane", "Failed", results="s3://results/lane/x")
        assert watch.end() == 1
        lines = watch.plain().splitlines()
    assert lines[-4].endswith("Complete; 4 of 4 cases: 4 passed; AllCasesRan: It ended.")
    assert lines[-3:-1] == ["Failed  lane: It ended.", "results: s3://results/lane/x"]
    assert lines[-1].endswith(f"results job/lane -n {namespace} --failed")
    assert len(lines) == 6


def test_watch_outlives_an_api_server_that_is_restarted(
    control_plane: ControlPlane, admin: Client, namespace: str
) -> None:
    admin.create(jobs(namespace), a_job("lane"))
    words = ("watch", "lane", "-n", namespace, "--timeout", "300s")
    with CliProcess(control_plane.kubeconfig, *words) as watch:
        watch.read_until("NotSeen: The operator has not looked at the job yet.")
        control_plane.stop_api_server()
        control_plane.start_api_server()
        report_end(admin, namespace, "lane", "Passed")
        assert watch.end(250) == 0


def test_a_job_that_is_deleted_ends_the_watch(
    control_plane: ControlPlane, admin: Client, namespace: str
) -> None:
    admin.create(jobs(namespace), a_job("lane"))
    with CliProcess(control_plane.kubeconfig, "watch", "lane", "-n", namespace) as watch:
        watch.read_until("NotSeen")
        admin.delete(jobs(namespace, "lane"))
        assert watch.end() == 2
        assert "job lane was deleted before it had ended" in watch.plain()


def test_the_timeout_bounds_the_watch(program: Program, admin: Client, namespace: str) -> None:
    admin.create(jobs(namespace), a_job("lane"))
    done = program("watch", "lane", "--timeout", "2s")
    assert done.status == 2
    assert "has not ended within 2 s, and goes on in the cluster; it is Pending" in done.stderr


def test_a_job_that_is_not_there_has_near_names(
    program: Program, admin: Client, namespace: str
) -> None:
    assert "and no other: is it in another namespace" in program("watch", "nightli").stderr
    admin.create(jobs(namespace), a_job("nightly"))
    for words in (("watch", "nightli"), ("logs", "nightli"), ("results", "job/nightli")):
        done = program(*words)
        assert done.status == 2
        assert f"no job nightli in namespace {namespace}: did you mean nightly?" in done.stderr


def test_a_namespace_that_is_not_there(control_plane: ControlPlane) -> None:
    given = json.dumps(manifest("lane"))
    for words in (("watch", "lane"), ("submit", "-")):
        done = run(control_plane.kubeconfig, *words, "-n", "nowhere", given=given)
        assert done.status == 2
        assert "there is no namespace nowhere" in done.stderr


def test_a_cluster_without_bagpipe(control_plane: ControlPlane, admin: Client) -> None:
    name = "simulationjobs.sim.bagpipe.io"
    crd = admin.get(f"{CRDS}/{name}")
    others = admin.get(f"{CRDS}/simulationschedules.sim.bagpipe.io")
    for each in (crd, others):
        admin.delete(f"{CRDS}/{each['metadata']['name']}")
    group = "/apis/sim.bagpipe.io/v1alpha1"
    wait_until(lambda: not admin.exists(group), WAIT_SECONDS, "the CRDs are still served")
    try:
        for words in (("watch", "lane"), ("submit", "-")):
            done = run(control_plane.kubeconfig, *words, given=json.dumps(manifest("lane")))
            assert done.status == 2
            assert "knows no SimulationJobs: Bagpipe is not installed there" in done.stderr
    finally:
        for each in (crd, others):
            kept = {key: each["metadata"][key] for key in ("name", "annotations")}
            install_crd(admin, {**each, "metadata": kept, "status": {}})


def test_who_may_not_learns_how_to_find_out(
    control_plane: ControlPlane, namespace: str, tmp_path: Path
) -> None:
    config = tmp_path / "config"
    control_plane.write_kubeconfig(config, control_plane.token(namespace, "default"))
    given = json.dumps(manifest("lane"))
    for words, verb in ((("watch", "lane"), "get"), (("submit", "-"), "create")):
        done = run(config, *words, "-n", namespace, given=given)
        assert done.status == 2
        assert f"you may not {verb} simulationjobs in namespace {namespace}" in done.stderr
        assert f"kubectl auth can-i {verb} simulationjobs.sim.bagpipe.io" in done.stderr


def test_the_role_of_the_page_is_enough(
    control_plane: ControlPlane, admin: Client, namespace: str, tmp_path: Path,
    later: ThreadPoolExecutor,
) -> None:  # fmt: skip
    page = (Path(__file__).parents[3] / "docs/tasks/ci-gate.md").read_text()
    block = next(b for b in page.split("```") if b.startswith("yaml") and "kind: Role" in b)
    role, binding = yaml.safe_load_all(block.removeprefix("yaml"))
    rbac = f"/apis/rbac.authorization.k8s.io/v1/namespaces/{namespace}"
    admin.create(core(namespace, "serviceaccounts"), {"metadata": {"name": "ci"}})
    role["metadata"]["namespace"] = namespace
    binding["metadata"]["namespace"] = binding["subjects"][0]["namespace"] = namespace
    admin.create(f"{rbac}/roles", role)
    admin.create(f"{rbac}/rolebindings", binding)
    config = tmp_path / "config"
    token = control_plane.token(namespace, "ci")
    await_right(admin.with_token(token), "create", namespace, "simulationjobs", "sim.bagpipe.io")
    control_plane.write_kubeconfig(config, token)
    given = json.dumps(manifest("lane"))
    words = ("submit", "-", "--wait", "--timeout", "300s", "-n", namespace)
    done = later.submit(run, config, *words, given=given)
    wait_until(lambda: admin.exists(jobs(namespace, "lane")), WAIT_SECONDS, "no job was made")
    report_end(admin, namespace, "lane", "Passed")
    assert done.result(WAIT_SECONDS).status == 0
    logs = run(config, "logs", "lane", "-n", namespace)
    assert "the job has no driver" in logs.stdout


@pytest.mark.parametrize(("outcome", "verdict", "status"), [
    ("passed", "Passed", 0), ("failed", "Failed", 1),
])  # fmt: skip
def test_the_pipeline_of_the_page_ends_with_the_verdict(
    control_plane: ControlPlane, admin: Client, namespace: str, tmp_path: Path,
    later: ThreadPoolExecutor, outcome: str, verdict: str, status: int,
) -> None:  # fmt: skip
    folder = publish(tmp_path, [make_row("a-0", outcome, "" if status == 0 else "Bad")])
    words = (tmp_path, manifest("lane"), namespace, PROGRAM)
    config = str(control_plane.kubeconfig)
    done = later.submit(pipeline.step, *words, KUBECONFIG=config)
    wait_until(lambda: bool(admin.items(jobs(namespace))), WAIT_SECONDS, "no job was made")
    [made] = admin.items(jobs(namespace))
    assert made["spec"]["stack"]["image"] == pipeline.IMAGE
    report_end(admin, namespace, made["metadata"]["name"], verdict, results=folder.as_uri())
    ended = done.result(WAIT_SECONDS)
    assert ended.returncode == status, ended.stderr
    assert (tmp_path / "results.txt").read_text().startswith(verdict)
    assert (tmp_path / "junit.xml").read_text().count("<testcase") == 1
    assert f"<title>{verdict}: drive</title>" in (tmp_path / "report.html").read_text()


def test_the_pipeline_of_the_page_stops_at_a_refused_job(
    control_plane: ControlPlane, admin: Client, namespace: str, tmp_path: Path
) -> None:
    words = (tmp_path, manifest("lane", sourc={}), namespace, PROGRAM)
    ended = pipeline.step(*words, KUBECONFIG=str(control_plane.kubeconfig))
    assert (ended.returncode, ended.stdout) == (2, "")
    assert "spec.sourc: there is no such field" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert admin.items(jobs(namespace)) == []


def test_results_by_name_and_logs_of_a_case(
    program: Program, admin: Client, namespace: str, tmp_path: Path
) -> None:
    admin.create(jobs(namespace), a_job("lane"))
    report(admin, namespace, "lane", RUNNING, phase="Running", cases={"planned": 4, "passed": 1})
    assert "is Running, 1 of 4 cases are done" in program("results", "lane").stderr
    rows = [make_row("a-0"), make_row("a-1", "errored", "StackExited") | {"stderr": ["boom"]}]
    folder = publish(tmp_path, rows)
    uri = f"pvc://results/{folder.relative_to(tmp_path)}"
    report_end(admin, namespace, "lane", "", results=uri)
    volume = ("--volume", f"results={tmp_path}")
    found = program("results", "lane", *volume, "--output", "json", "--junit", str(tmp_path / "j"))
    assert (found.status, len(json.loads(found.stdout)["cases"])) == (2, 2)
    assert (tmp_path / "j").read_text().count("<testcase") == 2
    assert "give --volume results=FOLDER" in program("results", "job/lane").stderr
    assert program("compare", "lane", "lane", *volume).status == 0
    assert program("report", "lane", *volume, "-o", str(tmp_path / "r.html")).status == 0
    logs = program("logs", "lane", "a-1", *volume)
    assert logs.status == 0
    assert logs.stdout.splitlines()[:2] == [
        f"== outcome ({folder.as_uri()}/results.jsonl)".replace(folder.as_uri(), uri),
        "errored StackExited",
    ]
    assert "boom" in logs.stdout
    assert "went with the end of the job" in logs.stdout
    nothing = program("logs", "lane", "a-1", "--output", "json")
    assert nothing.status == 2
    assert "give --volume results=FOLDER" in json.loads(nothing.stdout)[0]["missing"]


def test_names_of_jobs_are_completed(
    control_plane: ControlPlane, admin: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("KUBECONFIG", str(control_plane.kubeconfig))
    with fresh_namespace(admin, "names") as namespace:
        for name in ("nightly-1", "nightly-2", "other"):
            admin.create(jobs(namespace), a_job(name))
        found = proposals(["watch", "-n", namespace, "night"])
        assert found == ["nightly-1", "nightly-2", ":4"]
        assert proposals(["results", "-n", namespace, "job/o"]) == ["job/other", ":4"]


def test_an_interrupt_is_no_verdict(
    program: Program, admin: Client, namespace: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    admin.create(jobs(namespace), a_job("lane"))
    asked = threading.Event()
    sleep = time.sleep

    def interrupted(seconds: float) -> None:
        # The module's function is everybody's, also that of threads which an earlier test left.
        if threading.current_thread() is not threading.main_thread():
            return sleep(seconds)
        asked.set()
        raise KeyboardInterrupt

    monkeypatch.setattr("bagpipe.cli.cluster.watching.time.sleep", interrupted)
    monkeypatch.setattr("bagpipe.cli.cluster.following._LONGEST_WATCH_SECONDS", 1.0)
    done = program("watch", "lane")
    assert asked.is_set()
    assert (done.status, "no longer watched; job lane goes on" in done.stderr) == (130, True)
