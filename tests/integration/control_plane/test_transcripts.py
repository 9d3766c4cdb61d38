"""Each verb's transcript in docs/reference/cli.md is what the program prints.

Against real parts: the agent and a real node over the real recording, in lock-step, and a real API
server. No operator runs: a job's status is what one would write. A pod of `pull` runs here.

`BAGPIPE_WRITE_TRANSCRIPTS=1` writes what is printed into the page.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.integration.control_plane.client import Client, core, jobs
from tests.integration.control_plane.exec_kubelet import serving
from tests.integration.control_plane.release import bound, find_helm, job_namespace
from tests.integration.control_plane.server import ControlPlane
from tests.integration.control_plane.test_cli import report
from tests.integration.control_plane.test_pull import driver_pod
from tests.integration.laptop import ROS_PATH, RUN_SECONDS
from tests.integration.stacks import EXAMPLE, folders_with_recording
from tests.transcripts import (
    FOLDER,
    NAMESPACE,
    PAGE,
    Step,
    alike,
    replaced,
    steps,
    transcripts,
    verbs,
)
from tests.unit.cli.cluster_objects import condition
from tests.waiting import patient

pytestmark = pytest.mark.integration

WRITES = bool(os.environ.get("BAGPIPE_WRITE_TRANSCRIPTS"))
WHEEL = '<parent link="bl_caster_rotation"/><child link="bl_caster_l_wheel"/>'
LIFTED = WHEEL + '<origin xyz="0 0 1.2"/>'


@dataclass(frozen=True)
class Place:
    """A folder with recordings, jobs and results, and a namespace of a cluster."""

    folder: Path
    programs: Path
    kubeconfig: Path
    namespace: str

    def printed(self, line: str, folder: Path | None = None) -> tuple[int, str]:
        """What a shell prints of a line, with the page's names, and its exit status."""
        folder = folder or self.folder
        scratch = folder / "tmp"
        scratch.mkdir(exist_ok=True)
        environment = {
            "PATH": f"{self.programs}:{ROS_PATH}", "HOME": str(folder), "TMPDIR": str(scratch),
            "KUBECONFIG": str(self.kubeconfig), "COLUMNS": "110", "LANG": "C.UTF-8",
        }  # fmt: skip
        done = subprocess.run(
            ["bash", "-c", line], cwd=folder, env=environment, timeout=RUN_SECONDS, text=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
        )  # fmt: skip
        text = done.stdout.replace(str(folder), FOLDER).replace(self.namespace, NAMESPACE)
        return done.returncode, text


def job(name: str, wheel: str) -> dict[str, Any]:
    """The example in two cases, judged by where a wheel is."""
    made = yaml.safe_load(EXAMPLE.read_text().replace(WHEEL, wheel))
    made["metadata"]["name"] = name
    spec = patient(made["spec"])
    spec["source"]["fragment"] = {"length": "8s", "warmUp": "1s"}
    field = "transforms[0].transform.translation.z"
    bounds = {"topic": "/tf", "field": field, "min": -1, "max": 1}
    spec["evaluate"] = [{"name": "wheel", "bounds": bounds}]
    return dict(made)


@pytest.fixture(scope="module")
def place(
    control_plane: ControlPlane, agent_binary: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Place]:
    """Results of two jobs, of which the later one is worse, here and in the cluster."""
    programs = tmp_path_factory.mktemp("bin")
    find_helm()
    with short_folder() as folder:
        yield from prepared(control_plane, agent_binary, folder, programs)


@contextmanager
def short_folder() -> Iterator[Path]:
    """A folder of just as long a name as the page's: so lines break at the same places."""
    folder = Path(tempfile.mkdtemp(prefix="lane-", dir="/tmp"))
    assert len(str(folder)) == len(FOLDER)
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


def prepared(
    control_plane: ControlPlane, agent_binary: Path, folder: Path, programs: Path
) -> Iterator[Place]:
    """The same, in a folder."""
    folders_with_recording(folder)
    recording = folder / "recordings/pr2/joint_states.bag"
    (folder / "cut.bag").write_bytes(recording.read_bytes()[:400_000])
    (programs / "bagpipe-agent").symlink_to(agent_binary)
    (programs / "bagpipe").symlink_to(Path(sys.executable).with_name("bagpipe"))
    made = {"released": job("released", WHEEL), "pr-812": job("pr-812", LIFTED)}
    for name, manifest in made.items():
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(manifest, sort_keys=False))
    admin = control_plane.admin
    with job_namespace(admin) as namespace, bound(admin, namespace):
        config = json.loads(control_plane.kubeconfig.read_text())
        config["contexts"][0]["context"]["namespace"] = namespace
        kubeconfig = programs / "kubeconfig"
        kubeconfig.touch(mode=0o600)
        kubeconfig.write_text(json.dumps(config))
        there = Place(folder, programs, kubeconfig, namespace)
        run_both(there, made)
        in_cluster(admin, namespace, made["pr-812"])
        claim = folder / "bagpipe-results"
        with serving(admin, control_plane.folder / "pki", namespace, claim):
            yield there


def run_both(place: Place, made: dict[str, Any]) -> None:
    """The results of both jobs, one after the other: a history has an order."""
    line = "bagpipe run {}.yaml --volume recordings=recordings"
    ended = [place.printed(line.format(name)) for name in made]
    assert [status for status, _ in ended] == [0, 1], ended


def in_cluster(admin: Client, namespace: str, manifest: dict[str, Any]) -> None:
    """The worse job, which has ended."""
    admin.create(jobs(namespace), manifest)
    admin.create(core(namespace, "pods"), driver_pod())
    ended = [condition("Complete", True, "AllCasesRan", "2 of 2 cases ran, verdict Failed")]
    report(
        admin, namespace, "pr-812", ended, phase="Complete", verdict="Failed",
        results="pvc://results/pr-812", driver="lane-1-driver",
        cases={"planned": 2, "failed": 2},
    )  # fmt: skip


@pytest.mark.parametrize("verb", verbs())
def test_the_transcript_is_what_is_printed(place: Place, verb: str) -> None:
    wanted = steps(transcripts(PAGE.read_text())[verb])
    assert any(step.line.startswith(f"bagpipe {verb} ") for step in wanted)
    found = []
    with short_folder() as folder:
        shutil.copytree(place.folder, folder, dirs_exist_ok=True)
        for step in wanted:
            status, printed = place.printed(step.line, folder)
            assert status == 0, f"`; echo $?` shows a status: {status} of {step.line}: {printed}"
            found.append(Step(step.line, printed))
    if WRITES:
        text = "".join(f"$ {step.line}\n{step.printed.rstrip()}\n" for step in found)
        PAGE.write_text(replaced(PAGE.read_text(), verb, text))
        return
    for shown, now in zip(wanted, found, strict=True):
        assert alike(now.printed).rstrip() == alike(shown.printed).rstrip(), shown.line
