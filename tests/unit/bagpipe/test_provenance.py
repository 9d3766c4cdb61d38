"""Where results come from: images as kubelets resolved them, machines, labels, discarded runs."""

import json
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import parse_qs, urlsplit

import pytest

from bagpipe.driver.own_pods import Looking, Seen, pods_of
from bagpipe.marks import marks_of
from bagpipe.run.ran_on import cpu_model, ran_on
from tests.unit.bagpipe.jobs import make_row
from tests.unit.bagpipe.serving import serving
from tests.unit.report.publishing import publish

STACK = "registry.example/lane@sha256:" + "a" * 64
MOVED = "registry.example/lane@sha256:" + "b" * 64


def pod(name: str, stack: str, node: str = "node-1") -> dict[str, Any]:
    return {
        "metadata": {"name": name},
        "spec": {
            "nodeName": node,
            "initContainers": [{"name": "stack", "image": "registry.example/lane:1.4"}],
            "containers": [{"name": "spark", "image": "bagpipe/spark:0.1.0"}],
        },
        "status": {
            "initContainerStatuses": [{"name": "stack", "imageID": stack}],
            # The kubelet has not pulled it yet.
            "containerStatuses": [{"name": "spark", "imageID": ""}],
        },
    }


def test_a_tag_that_moved_between_two_executors_shows_as_two_digests() -> None:
    seen = Seen()
    seen.add([pod("x-1", f"docker-pullable://{STACK}"), pod("x-2", MOVED, "node-2")])
    seen.add([pod("x-1", STACK), pod("x-3", STACK)])  # looked at again
    assert seen.images() == [
        {"container": "stack", "image": "registry.example/lane:1.4", "digest": d, "pods": n}
        for d, n in ((STACK, 2), (MOVED, 1))
    ]
    assert seen.nodes == {"x-1": "node-1", "x-2": "node-2", "x-3": "node-1"}


class ApiServer(BaseHTTPRequestHandler):
    """Two pages of pods for whoever has the token."""

    asked: ClassVar[list[dict[str, list[str]]]] = []

    def do_GET(self) -> None:
        url = urlsplit(self.path)
        if self.headers["Authorization"] != "Bearer the-token":
            self.send_error(403)
            return
        asked = parse_qs(url.query)
        self.asked.append(asked | {"path": [url.path]})
        more = "" if "continue" in asked else "page-2"
        page = {"metadata": {"continue": more}, "items": [pod(f"x-{len(self.asked)}", STACK)]}
        self.send_response(200)
        self.end_headers()
        self.wfile.write(json.dumps(page).encode())


@pytest.fixture
def api() -> Iterator[str]:
    ApiServer.asked.clear()
    with serving(ApiServer) as address:
        yield address


def test_the_pods_of_the_job_alone_are_listed_page_by_page(api: str, tmp_path: Path) -> None:
    (tmp_path / "token").write_text("the-token\n")
    found = pods_of("lab", "uid-1", api, tmp_path)
    assert [each["metadata"]["name"] for each in found] == ["x-1", "x-2"]
    assert [asked["path"] for asked in ApiServer.asked] == [["/api/v1/namespaces/lab/pods"]] * 2
    assert ApiServer.asked[0]["labelSelector"] == ["sim.bagpipe.io/job-uid=uid-1"]


def test_pods_that_can_t_be_listed_end_no_job(api: str, tmp_path: Path) -> None:
    (tmp_path / "token").write_text("another")
    seen = Seen()
    with Looking(lambda: pods_of("lab", "uid-1", api, tmp_path), seen):
        pass
    assert (seen.images(), ApiServer.asked) == ([], [])


def test_they_are_looked_at_once_more_when_the_work_is_done() -> None:
    seen = Seen()
    with Looking(lambda: [pod("x-1", STACK)], seen):
        assert seen.images() == []
    assert [image["pods"] for image in seen.images()] == [1]


def test_the_manifest_says_where_its_rows_come_from(tmp_path: Path) -> None:
    here = {"host": "x-exec-1", "cpu": "EPYC", "arch": "x86_64", "kernel": "6.1", "cpus": 8}
    busy = {"reason": "MachineBusy", "message": "the player was late", "seconds": 5.5, "ledger": {}}
    rows = [
        make_row("a", ran_on=here, result={"software": "bagpipe-agent 0.1.0"}, seed=3),
        make_row("b", ran_on=here | {"host": "x-exec-2"}, discarded=[busy, busy], attempts=3),
        make_row("c", ran_on=here | {"kernel": "6.6"}, discarded=["AgentDied"], attempts=2),
    ]
    folder = publish(tmp_path, rows)
    manifest = json.loads((folder / "manifest.json").read_text())
    found = manifest["provenance"]
    assert (found["agents"], found["seeds"]) == (["bagpipe-agent 0.1.0"], [0, 3])
    assert [(m["cases"], m["kernel"], m["names"]) for m in found["machines"]] == [
        (2, "6.1", ["x-exec-1", "x-exec-2"]),
        (1, "6.6", ["x-exec-1"]),
    ]
    assert found["discarded"] == {"MachineBusy": 2, "AgentDied": 1}
    assert found["began"].endswith("Z")
    assert found["ended"] >= found["began"]
    assert [case["discarded"] for case in manifest["cases"]] == [
        [],
        [{key: busy[key] for key in ("reason", "message", "seconds")}] * 2,
        [{"reason": "AgentDied", "message": "", "seconds": None}],
    ]
    job = json.loads((folder / "job.json").read_text())
    assert json.loads(job["metadata"]["annotations"]["sim.bagpipe.io/provenance"]) == found


def test_labels_and_our_annotations_are_kept_and_nothing_else() -> None:
    commit = {"sim.bagpipe.io/commit": "0c1f", "sim.bagpipe.io/provenance": "of an earlier job"}
    applied = {"kubectl.kubernetes.io/last-applied-configuration": '{"env": "a password"}'}
    assert marks_of({"branch": "main", "number": 12}, commit | applied) == {
        "labels": {"branch": "main", "number": "12"},
        "annotations": {"sim.bagpipe.io/commit": "0c1f"},
    }


@pytest.mark.parametrize(
    ("cpu_info", "model"),
    [
        ("processor : 0\nmodel name\t: AMD  EPYC 7R13\nmodel name : other\n", "AMD EPYC 7R13"),
        ("processor : 0\nBogoMIPS : 50\nModel : Raspberry Pi 5\n", "Raspberry Pi 5"),
        ("processor : 0\nCPU implementer : 0x41\n", ""),
        ("", ""),
    ],
)
def test_the_processor_is_named_as_the_kernel_names_it(cpu_info: str, model: str) -> None:
    assert cpu_model(cpu_info) == model


def test_this_machine_has_an_architecture_and_a_kernel() -> None:
    found = ran_on()
    assert found["arch"]
    assert found["kernel"]
    assert found["cpus"] >= 1
