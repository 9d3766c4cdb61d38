"""What kind's rig does to a container's configuration, and what its node is made of."""

from __future__ import annotations

import json
import os
import re
import stat
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from embedded import builds, preflight
from embedded.failure import ClusterError
from kind import bounded, engine, node

# Of a machine without CAP_SYS_RESOURCE, and of one with all 41.
WITHOUT, WITH = "000001fffeffffff", "000001ffffffffff"


def status(mask: str) -> str:
    return f"CapEff:\t0000000000000000\nCapBnd:\t{mask}\nCapAmb:\t0000000000000000\n"


def process() -> dict[str, object]:
    """As Docker asks for --privileged: more than there may be."""
    return {
        "args": ["/sbin/init"],
        "capabilities": {
            "bounding": ["CAP_CHOWN", "CAP_SYS_RESOURCE", "CAP_OF_TOMORROW"],
            "effective": ["CAP_SYS_RESOURCE"],
            "ambient": None,
        },
        "oomScoreAdj": -500,
        "rlimits": [{"type": "RLIMIT_NOFILE", "hard": 1048576, "soft": 1048576}],
    }


def test_a_bounding_set_is_read_by_name() -> None:
    everything = {f"CAP_{name}" for name in bounded.CAPABILITIES}
    assert len(everything) == 41
    assert bounded.bounding_set(status(WITH)) == everything
    assert everything - bounded.bounding_set(status(WITHOUT)) == {"CAP_SYS_RESOURCE"}


@pytest.mark.parametrize(
    ("mask", "bounding", "score", "limits"),
    [(WITHOUT, ["CAP_CHOWN"], 0, 0), (WITH, ["CAP_CHOWN", "CAP_SYS_RESOURCE"], -500, 1)],
)
def test_a_container_gets_what_the_machine_has(
    mask: str, bounding: list[str], score: int, limits: int
) -> None:
    wanted = process()
    bounded.restrict(wanted, bounded.bounding_set(status(mask)))
    assert wanted["capabilities"] == {
        "bounding": bounding,
        "effective": bounding[1:],
        "ambient": [],
    }
    assert wanted["oomScoreAdj"] == score
    assert len(wanted.get("rlimits", [])) == limits  # type: ignore[arg-type]
    assert wanted["args"] == ["/sbin/init"]


@pytest.mark.parametrize(
    ("arguments", "file", "nested"),
    [
        (["--root", "r", "create", "--bundle", "{}", "--pid-file", "p", "id"], "config.json", True),
        (["run", "-b", "{}", "id"], "config.json", True),
        (["exec", "--process={}/process.json", "id"], "process.json", False),
        (["exec", "--detach", "-p", "{}/process.json", "id"], "process.json", False),
    ],
)
def test_runc_finds_the_changed_configuration(
    tmp_path: Path, arguments: list[str], file: str, nested: bool
) -> None:
    document = {"process": process(), "hostname": "node"} if nested else process()
    (tmp_path / file).write_text(json.dumps(document))
    given = [argument.format(tmp_path) for argument in arguments]
    bounded.rewrite(given, bounded.bounding_set(status(WITHOUT)))
    found = json.loads((tmp_path / file).read_text())
    assert (found.get("hostname") == "node") is nested
    assert found.get("process", found)["capabilities"]["bounding"] == ["CAP_CHOWN"]


@pytest.mark.parametrize(
    "arguments", [["kill", "id", "9"], ["exec", "id", "true"], ["--version"], ["delete", "run"]]
)
def test_other_commands_change_nothing(tmp_path: Path, arguments: list[str]) -> None:
    configuration = tmp_path / "config.json"
    configuration.write_text(json.dumps({"process": process()}))
    before = configuration.read_text()
    program = tmp_path / "runc"
    program.write_text('#!/bin/sh\necho "$@"\n')
    program.chmod(0o755)
    path = f"{tmp_path}:{os.environ['PATH']}"
    done = subprocess.run(
        [sys.executable, engine.RUNTIME, *arguments],
        cwd=tmp_path,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == arguments
    assert configuration.read_text() == before


def test_docker_can_start_the_runtime() -> None:
    assert engine.RUNTIME.stat().st_mode & stat.S_IXUSR
    assert f"bounded={engine.RUNTIME}" in engine.command()


def test_the_engine_leaves_the_machines_firewall_alone() -> None:
    assert {"--iptables=false", "--ip6tables=false", "--ip-forward=false", "--bridge=none"} <= set(
        engine.command()
    )


def test_an_engine_that_does_not_answer_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A client whose daemon has taken its connection, and nothing more, waits for ever.
    client = tmp_path / "docker"
    client.write_text("#!/bin/sh\nexec sleep 600\n")
    client.chmod(0o755)
    monkeypatch.setattr(engine, "environment", lambda: {"PATH": f"{tmp_path}:/usr/bin:/bin"})
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    monkeypatch.setattr(engine, "ANSWER_SECONDS", 0.1)
    assert not engine.answers()


def test_where_docker_is_missing_a_verb_that_there_is_gets_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(engine.shutil, "which", lambda _program: None)
    with pytest.raises(ClusterError) as caught, engine.running():
        pass
    (verb,) = re.findall(r"`make ([a-z-]+)`", str(caught.value))
    makefile = (Path(__file__).resolve().parents[2] / "Makefile").read_text()
    recipe = re.search(rf"^{verb}:.*\n((?:\t.*\n)+)", makefile, re.MULTILINE)
    assert recipe is not None
    assert re.search(r"preflight .*\bkind\b", recipe[1])


def test_no_machine_gets_docker_unless_kind_is_asked_for() -> None:
    everybodys = {package for packages in preflight.PACKAGES.values() for package in packages}
    assert everybodys.isdisjoint(preflight.BY_NAME["kind"])


def test_the_node_has_a_volume_for_each_of_its_folders() -> None:
    of_class, *volumes = yaml.safe_load_all(node.claims())
    assert of_class["metadata"]["annotations"] == {
        "storageclass.kubernetes.io/is-default-class": "true"
    }
    made = (node.FILES / "node.Dockerfile").read_text().split("mkdir -p -m 777 ")[1].split()
    paths = [volume["spec"]["hostPath"]["path"] for volume in volumes]
    assert paths == made[: node.CLAIMS]
    assert {v["spec"]["storageClassName"] for v in volumes} == {of_class["metadata"]["name"]}


def test_kubeadm_is_of_the_version_of_kubernetes() -> None:
    modules = (builds.sources() / "kubeadm" / "go.mod").read_text()
    assert f"k8s.io/kubernetes v{builds.KUBERNETES} " in modules


def test_another_file_makes_another_node(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "kubernetes-1"
    (tmp_path / "files").mkdir()
    (tmp_path / "files" / "entrypoint").write_text("one")
    monkeypatch.setattr(node, "FILES", tmp_path / "files")
    first = [node.content(program), node.content(program)]
    (tmp_path / "files" / "entrypoint").write_text("two")
    assert first[0] == first[1] != node.content(program)
    assert node.content(program) != node.content(tmp_path / "kubernetes-2")
