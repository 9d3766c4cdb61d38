"""What of a job this machine can't give, and what is otherwise here."""

from pathlib import Path
from typing import Any

import pytest

from bagpipe.cli.here import Machine, notes, of_variants, refusals, without_schedule
from bagpipe.matrix.faults import MatrixError
from tests.unit.bagpipe.jobs import make_spec

VOLUMES = {"recordings": "/data"}
SECRET = {"secretKeyRef": {"name": "login", "key": "token"}}
OWN = {"name": "smooth", "own": {"configMap": "comfort", "topics": ["/out"]}}


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    """One that has a rosmaster and the stack `run`, and no entrypoint."""
    for name in ("rosmaster", "run"):
        program = tmp_path / name
        program.write_text("#!/bin/sh\n")
        program.chmod(0o755)
    return Machine({"PATH": str(tmp_path), "TOKEN": "x"}, tmp_path / "no-entrypoint.sh")


def stack(**changed: Any) -> dict[str, Any]:
    return {"image": "stack:1", "command": ["run"]} | changed


def refused(machine: Machine, volumes: dict[str, str] = VOLUMES, **changed: Any) -> list[str]:
    return list(refusals(make_spec(**changed), volumes, machine))


def test_a_job_that_needs_nothing_else_is_not_refused(machine: Machine) -> None:
    assert refused(machine) == []
    # Where the results would go on a cluster needs no folder.
    assert refused(machine, output={"uri": "pvc://elsewhere/out"}) == []


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"resumeFrom": "yesterday"}, "spec.resumeFrom names a job of a cluster"),
        ({"evaluate": [OWN]}, "evaluate[smooth] is a program in the ConfigMap comfort"),
        (
            {"stack": stack(env=[{"name": "KEY", "valueFrom": SECRET}])},
            "set KEY in your environment",
        ),
        (
            {"stack": stack(volumeMounts=[{"name": "m", "mountPath": "/no/models"}])},
            "stack.volumeMounts has /no/models, which is not on this machine",
        ),
        ({"stack": stack(command=["node"])}, "stack.command starts node, which is not found"),
        ({"baseline": {"results": "pvc://old/r"}}, "give --volume old=FOLDER"),
        (
            {"variants": [{"name": "a"}, {"name": "b", "image": "stack:2"}]},
            "the variants a and b differ in their images alone",
        ),
        (
            {"variants": [{"name": "a", "command": ["run"]}, {"name": "b", "command": ["new"]}]},
            "stack.command starts new,",
        ),
        (
            {
                "matrix": {"variables": {"program": ["run", "walk"]}},
                "stack": stack(command=["{{ program }}"]),
            },
            "stack.command starts walk,",
        ),
    ],
)
def test_what_is_not_available_here_is_reported_with_a_remedy(
    machine: Machine, changed: dict[str, Any], sentence: str
) -> None:
    (only,) = refused(machine, **changed)
    assert sentence in only


def test_all_that_is_missing_is_reported_at_once(machine: Machine) -> None:
    nowhere = Machine({"PATH": "/nowhere"}, machine.entrypoint)
    sentences = refused(nowhere, {}, stack=stack(ros1={"master": "image"}))
    assert ["claim recordings" in sentences[0], "starts run" in sentences[1]] == [True, True]
    assert sentences[2] == (
        "stack.ros1.master: image needs rosmaster, which is not found here: put its folder on PATH"
        " (such as by sourcing setup.bash), or run this inside of the stack's image"
    )
    assert len(sentences) == 3


def test_a_program_of_its_own_needs_no_ros(machine: Machine) -> None:
    own = stack(command=["simulate"], engine="exec")
    (only,) = refused(machine, source={"files": ["pvc://recordings/a"]}, stack=own, record=None)
    assert only == (
        "stack.command starts simulate, which is not found here: put its folder on PATH, or run"
        " this inside of the stack's image"
    )


@pytest.mark.parametrize(
    "env",
    [
        [{"name": "TOKEN", "valueFrom": SECRET}],
        [
            {
                "name": "KEY",
                "valueFrom": {"secretKeyRef": {"name": "l", "key": "k", "optional": True}},
            }
        ],
        [{"name": "KEY", "value": "written"}],
    ],
)
def test_a_variable_that_this_environment_has_is_taken_from_it(
    machine: Machine, env: list[dict[str, Any]]
) -> None:
    assert refused(machine, stack=stack(env=env)) == []


def test_only_the_rosmaster_of_an_image_is_looked_for(machine: Machine, tmp_path: Path) -> None:
    (tmp_path / "rosmaster").unlink()
    assert refused(machine) == []
    own = refused(machine, stack=stack(ros1={"master": "image"}))
    assert "stack.ros1.master: image needs rosmaster" in own[0]
    source = {"files": ["pvc://recordings/*.bin"]}
    assert refused(machine, source=source, stack=stack(engine="exec"), record=None) == []


def test_nodes_of_ros_2_need_one_that_is_sourced_and_no_rosmaster(
    machine: Machine, tmp_path: Path
) -> None:
    (tmp_path / "rosmaster").unlink()
    (only,) = refused(machine, stack=stack(engine="ros2"))
    assert only == (
        "stack.engine: ros2 plays by a ROS 2's librcl.so, which is not found here: source its"
        " setup.bash, which sets AMENT_PREFIX_PATH, or write stack.ros2.player: dds where the stack"
        " has ROS 2 linked statically, or run this inside of the stack's image"
    )
    for player, needs in [("auto", 1), ("rcl", 1), ("dds", 0)]:
        chosen = stack(engine="ros2", ros2={"player": player})
        assert len(refused(machine, stack=chosen)) == needs, player
    prefix = {"AMENT_PREFIX_PATH": "/opt/ros/jazzy"}
    sourced = Machine({**machine.environment, **prefix}, machine.entrypoint)
    assert refused(sourced, stack=stack(engine="ros2")) == []
    own = [{"name": name, "value": value} for name, value in prefix.items()]
    assert refused(machine, stack=stack(engine="ros2", env=own)) == []
    libraries = {"LD_LIBRARY_PATH": f"/nowhere:{tmp_path}"}
    loading = Machine({**machine.environment, **libraries}, machine.entrypoint)
    assert "librcl.so" in refused(loading, stack=stack(engine="ros2"))[0]
    (tmp_path / "librcl.so").touch()
    assert refused(loading, stack=stack(engine="ros2")) == []


def test_the_stack_s_own_path_and_an_image_s_entrypoint_find_programs(
    machine: Machine, tmp_path: Path
) -> None:
    nowhere = Machine({"PATH": "/nowhere"}, machine.entrypoint)
    path = [{"name": "PATH", "value": str(tmp_path)}]
    assert refused(nowhere, stack=stack(env=path)) == []
    entrypoint = tmp_path / "ros_entrypoint.sh"
    entrypoint.touch()
    assert refused(Machine({"PATH": "/nowhere"}, entrypoint)) == []


def test_variants_are_chosen_by_name(machine: Machine) -> None:
    variants = [{"name": "a"}, {"name": "b", "image": "stack:2"}]
    spec = make_spec(variants=variants)
    left = of_variants(spec, ("b",))
    assert [variant.name for variant in left.variants] == ["b"]
    assert list(refusals(left, VOLUMES, machine)) == []
    assert of_variants(spec, ()) == spec
    with pytest.raises(MatrixError, match="--variant c: the job's variants are a, b"):
        of_variants(spec, ("c",))


def test_notes_say_what_is_otherwise_here() -> None:
    spec = make_spec(
        stack=stack(
            command=["run", "/opt/no-such/node.py"],
            envFrom=[{"secretRef": {"name": "login"}}],
            resources={"limits": {"memory": "1Gi"}},
        ),
        storage={"secrets": ["keys"]},
        activeDeadline="60s",
    )
    sentences = "\n".join(notes(spec, Path("kept")))
    for sentence in (
        "images are not used here",
        "stack.command names /opt/no-such/node.py, which is not on this machine",
        "stack.envFrom names login of a cluster",
        "storage's credentials come from your environment",
        "without effect here: spec.activeDeadline, spec.stack.resources",
        "the results go to kept, not to pvc://results/out",
    ):
        assert sentence in sentences
    plain = list(notes(make_spec(), Path("kept")))
    assert [sentence.split()[0] for sentence in plain] == ["images", "the"]


def test_topics_of_a_command_are_no_files_of_this_machine() -> None:
    spec = make_spec(
        stack=stack(
            command=["run", "/camera", "/seen", "/old", "/a:=/b", "--sub", "/in:T", "/no/such"],
            remap={"/old": "/new"},
        ),
        source={"bags": ["pvc://rec/a.bag"], "topics": ["/camera"]},
        record={"topics": ["/seen"]},
    )
    named = [sentence for sentence in notes(spec, Path("kept")) if "stack.command" in sentence]
    assert named == ["stack.command names /no/such, which is not on this machine"]


def test_a_schedule_is_of_a_cluster_and_nothing_is_compared_here(machine: Machine) -> None:
    spec, found = without_schedule(make_spec(baseline={"lastPassed": "schedule/nightly"}))
    assert spec.baseline is None
    assert found is not None
    assert (found.schedule, found.job) == ("nightly", "")
    assert found.message.startswith(
        "nothing is compared: spec.baseline.lastPassed names the schedule nightly of a cluster"
    )
    assert refused(machine, baseline={"lastPassed": "schedule/nightly"}) == []
    explicit = make_spec(baseline={"results": "pvc://old/r"})
    assert without_schedule(explicit) == (explicit, None)
