"""The gate of others' pipelines (ci/gate.sh) over results that the real program shows and compares.

In place of `bagpipe submit` and `run` stand a few lines of shell that end in a given way; results,
JUnit, report and comparison are the program's own. In place of gh stands what keeps its words.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
import yaml

from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish

ROOT = Path(__file__).parents[3]
IMAGE = "registry.example/lane:pr-812"
SECONDS = 120
# The real program stands for all verbs that read results.
PROGRAM = """\
#!/bin/bash
echo "$@" >>"$WORDS"
case $1 in
submit) cp "$2" "$WORDS.job"; eval "$SUBMIT" ;;
run)
  while [ "$1" != --results ]; do shift; done
  cp -r "$RESULTS" "$2"
  eval "$SUBMIT"
  ;;
*)
  words=()
  for word; do
    case $word in
    -n | lanes) ;;
    job/*) words+=("$RESULTS") ;;
    *) words+=("$word") ;;
    esac
  done
  exec "$PYTHON" -m bagpipe.cli "${words[@]}"
  ;;
esac
"""


@dataclass(frozen=True)
class Pipeline:
    """A folder in which a pipeline runs the gate, and the words of all that it called."""

    folder: Path
    results: Path

    def run(self, submit: str, **settings: str) -> subprocess.CompletedProcess[str]:
        given = {
            "PATH": f"{self.folder / 'bin'}:{os.environ['PATH']}",
            "WORDS": str(self.folder / "words"),
            "RESULTS": str(self.results),
            "PYTHON": sys.executable,
            "SUBMIT": submit,
            "BAGPIPE_JOB": "job.yaml",
            "BAGPIPE_IMAGE": IMAGE,
        }
        return subprocess.run(
            [str(ROOT / "ci/gate.sh")], cwd=self.folder, env={**os.environ, **given, **settings},
            capture_output=True, text=True, timeout=SECONDS, check=False,
        )  # fmt: skip

    def words(self) -> list[str]:
        return (self.folder / "words").read_text().splitlines()

    def kept(self, name: str) -> str:
        return (self.folder / "bagpipe-ci" / name).read_text()


@pytest.fixture
def baseline(tmp_path: Path) -> Path:
    """The results of a job whose three cases passed."""
    return publish(tmp_path, [make_row(f"a-{n}") for n in range(3)], uid="before")


@pytest.fixture
def pipeline(tmp_path: Path) -> Pipeline:
    """A job of three cases of which one failed, with words that would be markup."""
    rows = [make_row("a-0"), make_row("a-1"), make_row("a-2", "failed", "Bad", message="```</pre>")]
    found = Pipeline(tmp_path / "ci", publish(tmp_path, rows, uid="after"))
    (found.folder / "bin").mkdir(parents=True)
    for name, text in (
        ("bagpipe", PROGRAM),
        ("poster", '#!/bin/sh\necho "poster $@" >>"$WORDS"\ncat "$3" >posted\n'),
    ):
        (found.folder / "bin" / name).write_text(text)
        (found.folder / "bin" / name).chmod(0o755)
    job = {"kind": "SimulationJob", "spec": {"stack": {"image": "@IMAGE@"}}}
    (found.folder / "job.yaml").write_text(yaml.safe_dump(job))
    return found


FAILED = """echo '{"name": "lane-x7k2p"}'; exit 1"""
PASSED = """echo '{"name": "lane-x7k2p"}'; exit 0"""


def test_a_failed_job_is_kept_compared_and_commented(pipeline: Pipeline, baseline: Path) -> None:
    ended = pipeline.run(
        FAILED,
        BAGPIPE_NAMESPACE="lanes",
        BAGPIPE_BASELINE=str(baseline),
        BAGPIPE_COMMENT="poster pr 812 ",
    )
    assert (ended.returncode, ended.stderr) == (1, "")
    submitted, results, report, compared, posted = pipeline.words()
    assert submitted == (
        "submit bagpipe-ci/job.yaml -n lanes --generate-name --wait --output json --timeout 30m"
    )
    assert results == "results job/lane-x7k2p -n lanes --junit bagpipe-ci/junit.xml"
    assert report == "report job/lane-x7k2p -n lanes --to bagpipe-ci/report.html"
    assert compared == f"compare {baseline} job/lane-x7k2p -n lanes"
    assert posted == "poster pr 812 bagpipe-ci/comment.md"
    sent = yaml.safe_load((pipeline.folder / "words.job").read_text())
    assert sent["spec"]["stack"]["image"] == IMAGE
    suites = ET.fromstring(pipeline.kept("junit.xml"))  # noqa: S314  the program's own
    assert (len(suites.findall(".//testcase")), len(suites.findall(".//failure"))) == (3, 1)
    assert "</html>" in pipeline.kept("report.html")


def test_the_comment_shows_verdict_cases_and_comparison_as_they_were_printed(
    pipeline: Pipeline, baseline: Path
) -> None:
    pipeline.run(FAILED, BAGPIPE_BASELINE=str(baseline))
    comment = pipeline.kept("comment.md")
    heading, _, rest = comment.partition("\n")
    assert heading == "## Bagpipe: not passed"
    # Nothing that a stack wrote begins a line, and so none of it is markup.
    own = [line for line in rest.splitlines() if line and not line.startswith("    ")]
    assert own == ["Compared with the baseline:"]
    for name in ("results.txt", "comparison.txt"):
        for line in pipeline.kept(name).splitlines():
            assert f"    {line}\n" in comment
    assert "1 failed" in pipeline.kept("results.txt")
    assert "worse" in pipeline.kept("comparison.txt")


def test_a_job_that_passed_and_is_worse_than_the_baseline_fails(
    pipeline: Pipeline, baseline: Path
) -> None:
    assert pipeline.run(PASSED).returncode == 0
    assert pipeline.kept("comment.md").startswith("## Bagpipe: Passed\n")
    assert pipeline.run(PASSED, BAGPIPE_BASELINE=str(baseline)).returncode == 1


def test_a_run_on_this_machine_reads_the_folder_that_it_wrote(
    pipeline: Pipeline, baseline: Path
) -> None:
    for name in ("a b", "maps"):
        (pipeline.folder / name).mkdir()
    ended = pipeline.run(
        FAILED,
        BAGPIPE_MODE="run",
        BAGPIPE_VOLUMES="recordings=a b\nmaps=maps\n",
        BAGPIPE_BASELINE=str(baseline),
    )
    assert ended.returncode == 1, ended.stderr
    volumes = "--volume recordings=a b --volume maps=maps"
    ran, results, *_ = pipeline.words()
    assert ran == (
        f"run bagpipe-ci/job.yaml {volumes} --results bagpipe-ci/results --replace --output json"
    )
    assert results == f"results bagpipe-ci/results {volumes} --junit bagpipe-ci/junit.xml"
    assert "1 failed" in pipeline.kept("comment.md")


def test_a_job_that_was_refused_says_so_in_the_comment(pipeline: Pipeline, baseline: Path) -> None:
    ended = pipeline.run(
        "echo 'Error: spec.output is missing' >&2; exit 2", BAGPIPE_BASELINE=str(baseline)
    )
    assert (ended.returncode, ended.stderr) == (2, "Error: spec.output is missing\n")
    assert len(pipeline.words()) == 1
    comment = pipeline.kept("comment.md")
    assert comment.startswith("## Bagpipe: no verdict\n\n    Error: spec.output is missing\n")
    assert not (pipeline.folder / "bagpipe-ci/junit.xml").exists()


def test_what_an_earlier_step_left_is_not_taken_for_this_job_s(pipeline: Pipeline) -> None:
    assert pipeline.run(PASSED).returncode == 0
    assert pipeline.run("exit 2").returncode == 2
    assert not (pipeline.folder / "bagpipe-ci/junit.xml").exists()
    assert pipeline.kept("comment.md").startswith("## Bagpipe: no verdict\n")


def test_a_comment_that_can_t_be_posted_takes_nothing_from_the_verdict(pipeline: Pipeline) -> None:
    ended = pipeline.run(PASSED, BAGPIPE_COMMENT="false")
    assert ended.returncode == 0
    assert ended.stderr == "gate: the comment was not posted (false)\n"


def test_of_a_long_log_the_end_is_shown(pipeline: Pipeline) -> None:
    pipeline.run('for n in $(seq 3000); do echo "Error: line $n" >&2; done; exit 2')
    lines = pipeline.kept("comment.md").splitlines()[2:]
    assert lines == [f"    Error: line {n}" for n in range(2901, 3001)]
    assert len(pipeline.kept("program.txt").splitlines()) == 3000


def test_what_no_comment_has_room_for_is_cut_and_says_so(pipeline: Pipeline) -> None:
    pipeline.run("for n in $(seq 60); do printf '%01000d\\n' $n >&2; done; exit 2")
    comment = pipeline.kept("comment.md")
    assert 28_000 < len(comment) < 28_100
    assert comment.endswith("\n\nThe rest is in program.txt.\n")


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"BAGPIPE_JOB": ""}, "BAGPIPE_JOB names no manifest"),
        ({"BAGPIPE_JOB": "none.yaml"}, "there is no manifest none.yaml"),
        ({"BAGPIPE_MODE": "try"}, "BAGPIPE_MODE is try; it can be submit or run"),
        ({"BAGPIPE_IMAGE": "a|e touch x"}, "BAGPIPE_IMAGE is no image's name: 'a|e touch x'"),
    ],
)
def test_what_makes_no_sense_is_refused(
    pipeline: Pipeline, settings: dict[str, str], sentence: str
) -> None:
    ended = pipeline.run(PASSED, **settings)
    assert (ended.returncode, ended.stderr) == (2, f"gate: {sentence}\n")
    assert not (pipeline.folder / "words").exists()


def test_the_action_hands_every_input_on_as_a_variable_that_the_gate_reads() -> None:
    action = yaml.safe_load((ROOT / "ci/action.yml").read_text())
    script = (ROOT / "ci/gate.sh").read_text()
    used = json.dumps(action["runs"])
    for name in action["inputs"]:
        assert f"inputs.{name}" in used
    for step in action["runs"]["steps"]:
        assert "${{" not in step["run"]
    environment = action["runs"]["steps"][-1]["env"]
    for name in (name for name in environment if name.startswith("BAGPIPE_")):
        assert f"#   {name} " in script
        assert f"{{{name}" in script or f"${name}" in script


def test_the_template_keeps_what_the_gate_writes() -> None:
    job = yaml.safe_load((ROOT / "ci/gitlab.yml").read_text())[".bagpipe"]
    assert job["artifacts"]["reports"]["junit"] == "$BAGPIPE_ARTIFACTS/junit.xml"
    assert job["artifacts"]["when"] == "always"
    assert job["script"][-1] == '"$BAGPIPE_CHECKOUT/ci/gate.sh"'


@pytest.mark.parametrize(
    ("image", "of_the_job", "refusal"),
    [
        (IMAGE, "registry.example/lane:released", "has no @IMAGE@"),
        (IMAGE, "registry.example/lane:1 # @IMAGE@ when it is back", "has no @IMAGE@"),
        ("", "'@IMAGE@'", "BAGPIPE_IMAGE names no image"),
    ],
)
def test_an_image_and_its_place_are_there_together_or_not_at_all(
    pipeline: Pipeline, image: str, of_the_job: str, refusal: str
) -> None:
    job = f"kind: SimulationJob\nspec:\n  stack:\n    image: {of_the_job}\n"
    (pipeline.folder / "job.yaml").write_text(job)
    ended = pipeline.run(PASSED, BAGPIPE_IMAGE=image)
    assert (ended.returncode, refusal in ended.stderr) == (2, True), ended.stderr
