"""Where a verb looks, and what it says before it has found a cluster."""

from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.cli.cluster.place import Place
from tests.unit.cli.test_plan import SPEC

JOB = {
    "apiVersion": "sim.bagpipe.io/v1alpha1",
    "kind": "SimulationJob",
    "metadata": {"name": "lane"},
    "spec": SPEC,
}


def run(*arguments: str, kubeconfig: str, given: str | None = None) -> tuple[int, str]:
    runner = CliRunner(env={"KUBECONFIG": kubeconfig})
    ended = runner.invoke(main, list(arguments), input=given)
    assert ended.exception is None or isinstance(ended.exception, SystemExit), ended.exception
    return ended.exit_code, ended.output


@pytest.fixture
def kubeconfig(tmp_path: Path) -> str:
    """A cluster at which nobody listens: port 1 of this machine."""
    path = tmp_path / "kubeconfig"
    config = {
        "apiVersion": "v1",
        "kind": "Config",
        "current-context": "lab",
        "clusters": [{"name": "lab", "cluster": {"server": "https://127.0.0.1:1"}}],
        "users": [{"name": "me", "user": {"token": "t"}}],
        "contexts": [{"name": "lab", "context": {"cluster": "lab", "user": "me"}}],
    }
    path.write_text(yaml.safe_dump(config))
    return str(path)


@pytest.mark.parametrize(
    ("where", "namespace", "job"),
    [
        ("job/nightly", None, "nightly"),
        ("job/nightly", "robots", "nightly"),
        ("nightly", "robots", "nightly"),
        ("nightly", None, None),
        ("./nightly", "robots", None),
        ("s3://results/nightly", "robots", None),
        (".", "robots", None),
    ],
)
def test_what_is_a_job_s_name(where: str, namespace: str | None, job: str | None) -> None:
    assert Place(None, namespace).job_in(where) == job


@pytest.mark.parametrize(
    "words",
    [("watch", "nightly"), ("logs", "nightly"), ("results", "job/nightly"),
     ("results", "nightly", "-n", "robots"), ("compare", "job/a", "job/b"),
     ("report", "job/nightly"), ("replay", "a-1", "--results", "job/nightly")],
)  # fmt: skip
def test_without_a_kubeconfig_each_verb_says_so(tmp_path: Path, words: tuple[str, ...]) -> None:
    status, text = run(*words, kubeconfig=str(tmp_path / "none"))
    assert status == 2
    assert "there is no kubeconfig:" in text
    assert "Set KUBECONFIG" in text


def test_a_context_that_is_not_there(kubeconfig: str) -> None:
    status, text = run("watch", "nightly", "--context", "moon", kubeconfig=kubeconfig)
    assert (status, "there is no context moon" in text, "there are: lab" in text) == (2, True, True)


def test_a_kubeconfig_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "bad").write_text("contexts: 7\n")
    status, text = run("watch", "nightly", kubeconfig=str(tmp_path / "bad"))
    assert status == 2
    assert "can't be used" in text


def test_a_cluster_that_does_not_answer(kubeconfig: str) -> None:
    status, text = run("logs", "nightly", kubeconfig=kubeconfig)
    assert status == 2
    assert "the cluster of context lab does not answer" in text
    assert "Connection refused" in text


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--name", "a", "--generate-name"), "both say how the job is called"),
        (("--dry-run", "--wait"), "no job that could be waited for"),
        (("--timeout", "soon"), "is not a duration"),
        (("-n", "other"), "the manifest says namespace robots and -n says other"),
    ],
)
def test_what_can_t_be_meant_is_refused(
    kubeconfig: str, words: tuple[str, ...], sentence: str
) -> None:
    job = JOB | {"metadata": {"name": "lane", "namespace": "robots"}}
    status, text = run("submit", "-", *words, kubeconfig=kubeconfig, given=yaml.safe_dump(job))
    assert status == 2
    assert sentence in text


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ("kind: ConfigMap\n", "holds 0 SimulationJobs, but ConfigMap: it"),
        ("{", "is no YAML"),
        (yaml.safe_dump(JOB | {"metadata": {}}), "metadata.name is missing"),
        (yaml.safe_dump(JOB | {"metadata": [1]}), "metadata is no map"),
        (yaml.safe_dump(JOB | {"apiVersion": "v2"}), "apiVersion is 'v2'"),
    ],
)
def test_what_is_no_manifest_is_refused(kubeconfig: str, given: str, sentence: str) -> None:
    status, text = run("submit", "-", kubeconfig=kubeconfig, given=given)
    assert status == 2
    assert sentence in text
