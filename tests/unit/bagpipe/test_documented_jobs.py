"""The manifests in the pages and of the examples are jobs, and the pages' programs run."""

import re
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from bagpipe.evaluate.judge import faults
from bagpipe.evaluate.model import KINDS
from bagpipe.evaluate.own import own
from bagpipe.plan.conditions import crossing
from bagpipe.plan.variant import check_templates
from bagpipe.spec import SimulationJobSpec, claims
from tests.unit.evaluate.recordings import STORE, evidence, header, pose

DOCS = Path(__file__).parents[3] / "docs"
TASKS = DOCS / "tasks"
EXAMPLES = DOCS / "examples"
JOBS = sorted(
    path for path in EXAMPLES.rglob("*.yaml") if "\nkind: SimulationJob\n" in path.read_text()
)


@pytest.mark.parametrize("page", ["s3.md", "hdfs.md"])
def test_the_job_of_a_task_page_is_valid_and_names_its_secret(page: str) -> None:
    blocks = re.findall(r"```yaml\n(.*?)```", (TASKS / page).read_text(), re.DOTALL)
    objects = [yaml.safe_load(textwrap.dedent(block)) for block in blocks]
    (job,) = [o for o in objects if o.get("kind") == "SimulationJob"]
    (secret,) = [o for o in objects if o.get("kind") == "Secret"]
    spec = SimulationJobSpec.model_validate(job["spec"])
    assert spec.storage.secrets == [secret["metadata"]["name"]]
    assert all(re.match(r"(AWS|AZURE|GOOGLE|HADOOP)_", key) for key in secret["stringData"])


def objects_of(page: str) -> list[dict[str, Any]]:
    """Every object of every block of YAML in a page of docs/."""
    text = (DOCS / page).read_text()
    blocks = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    return [found for block in blocks for found in yaml.safe_load_all(textwrap.dedent(block))]


@pytest.mark.parametrize(
    "page",
    [
        "../README.md",
        "tasks/criteria.md",
        "tasks/from-ros2-bag-play.md",
        "tasks/gpus.md",
        "tasks/own-evaluator.md",
        "tasks/own-stack.md",
        "concepts/matrix.md",
    ],
)
def test_the_jobs_of_a_page_can_be_planned_and_judged(page: str) -> None:
    jobs = [o for o in objects_of(page) if o.get("kind") == "SimulationJob"]
    assert jobs
    for job in jobs:
        spec = SimulationJobSpec.model_validate(job["spec"])
        check_templates(spec)
        assert faults(spec.evaluate) == []
    for part in (o for o in objects_of(page) if "spec" in o and "kind" not in o):
        SimulationJobSpec.model_validate(merged(jobs[0]["spec"], part["spec"]))


def merged(whole: Any, part: Any) -> Any:
    """A job's spec with what a page says to write into it."""
    if not (isinstance(whole, dict) and isinstance(part, dict)):
        return part
    return whole | {key: merged(whole.get(key), value) for key, value in part.items()}


def test_the_pod_for_copying_has_the_claims_of_the_job_beside_it() -> None:
    objects = objects_of("tasks/own-stack.md")
    # The page's first job; the second one is its like for ROS 2.
    ros1, ros2 = (
        SimulationJobSpec.model_validate(o["spec"])
        for o in objects
        if o.get("kind") == "SimulationJob"
    )
    [pod] = [o["spec"] for o in objects if o.get("kind") == "Pod"]
    [container] = pod["containers"]
    mounted = {mount["name"]: mount["mountPath"] for mount in container["volumeMounts"]}
    volumes = {v["name"]: v["persistentVolumeClaim"]["claimName"] for v in pod["volumes"]}
    assert {volumes[name]: path for name, path in mounted.items()} == {
        claim: f"/{claim}" for claim in claims(ros1)
    }
    assert claims(ros2) == claims(ros1)
    # Any image will do that the nodes have already.
    assert container["image"] == ros1.stack.image
    assert ros2.stack.engine == "ros2"


def test_the_examples_say_how_a_recording_gets_onto_the_claim() -> None:
    anchor = "../../tasks/own-stack.md#copy-to-a-claim-and-from-it"
    for path in sorted(EXAMPLES.rglob("*")):
        if path.suffix not in (".md", ".yaml"):
            continue
        text = path.read_text()
        copied = re.findall(r"kubectl cp \S+ (.*):/recordings/(?:(.*)/)?", text)
        assert {pod for pod, _ in copied} <= {"toolbox"}, path
        # kubectl cp makes no folders.
        for folder in {folder for _, folder in copied if folder}:
            assert f"kubectl exec toolbox -- mkdir -p /recordings/{folder}\n" in text, path
        if path.name == "README.md" and "kubectl cp" in text:
            assert anchor in text, path


def test_the_page_on_criteria_has_every_kind() -> None:
    [job] = objects_of("tasks/criteria.md")
    spec = SimulationJobSpec.model_validate(job["spec"])
    assert {criterion.kind for criterion in spec.evaluate} == set(KINDS)
    text = (DOCS / "tasks/criteria.md").read_text()
    assert [kind for kind in KINDS if f"\n| `{kind}` |" not in text] == []


def test_the_matrix_of_its_page_gives_what_the_page_says() -> None:
    [job] = objects_of("concepts/matrix.md")
    spec = SimulationJobSpec.model_validate(job["spec"])
    made = crossing(spec)
    assert made.expansion is not None
    assert len({c.scenario for _, c in made.named}) == 20
    assert {c.seed for _, c in made.named} == {0, 1}
    assert {e.because for e in made.expansion.excluded} == {"never driven"}


@pytest.mark.parametrize(("step", "outcome"), [(0.1, "passed"), (0.5, "failed")])
def test_the_evaluator_of_its_page_runs(tmp_path: Path, step: float, outcome: str) -> None:
    found = {o["kind"]: o for o in objects_of("tasks/own-evaluator.md")}
    (tmp_path / "comfort").mkdir()
    program = found["ConfigMap"]["data"]["evaluator.py"]
    (tmp_path / "comfort" / "evaluator.py").write_text(program)
    [criterion] = SimulationJobSpec.model_validate(found["SimulationJob"]["spec"]).evaluate
    assert criterion.own is not None
    drive = [("/odom", 10 + n * 0.1, odometry(10 + n * 0.1, n * step)) for n in range(20)]
    judged = own(criterion.name, criterion.own, evidence(drive), tmp_path)
    assert judged.outcome == outcome
    assert judged.figure == pytest.approx(step / 0.1, rel=1e-6)


def odometry(stamp: float, speed: float) -> Any:
    types = STORE.types
    zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    forward = types["geometry_msgs/msg/Vector3"](speed, 0.0, 0.0)
    still = np.zeros(36)
    return types["nav_msgs/msg/Odometry"](
        header(stamp),
        "base",
        types["geometry_msgs/msg/PoseWithCovariance"](pose(0.0, 0.0), still),
        types["geometry_msgs/msg/TwistWithCovariance"](
            types["geometry_msgs/msg/Twist"](forward, zero), still
        ),
    )


def test_all_examples_are_looked_at() -> None:
    found = {str(path.relative_to(EXAMPLES)) for path in JOBS}
    assert found >= {
        "barrier-car/dusk.yaml",
        "barrier-car/job.yaml",
        "exec-highway/job.yaml",
        "localisation/job.yaml",
        "obstacles-node/job.yaml",
        "pedestrians-node/job.yaml",
        "pedestrians-node/nobody.yaml",
        "recombined/job.yaml",
        "robot-state-publisher/job.yaml",
        "robot-state-publisher/realtime.yaml",
    }


@pytest.mark.parametrize("path", JOBS, ids=lambda path: str(path.relative_to(EXAMPLES)))
def test_an_examples_job_is_valid_and_listed(path: Path) -> None:
    job = yaml.safe_load(path.read_text())
    spec = SimulationJobSpec.model_validate(job["spec"])
    check_templates(spec)
    assert faults(spec.evaluate) == []
    assert f"({path.parent.name}" in (EXAMPLES / "README.md").read_text()
