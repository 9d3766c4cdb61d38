"""`bagpipe bisect --images`: jobs of a cluster that each leave real results, and none is left."""

import json
import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner, Result

from bagpipe.cli.__main__ import main
from bagpipe.cli.cluster.faults import ClusterError
from bagpipe.cli.cluster.place import Place
from bagpipe.cli.images_tried import images_between, interruptible, job_of
from bagpipe.cli.places import RefusedError
from tests.unit.bagpipe.jobs import make_row
from tests.unit.cli.cluster_objects import Json, a_job, ended
from tests.unit.report.publishing import publish

SPEC = {
    "source": {"bags": ["pvc://recordings/*.bag"]},
    "stack": {"image": "lane:0", "command": ["run"]},
    "record": {"topics": ["/out"]},
    "output": {"uri": "pvc://results/out"},
    "baseline": {"results": "pvc://results/earlier"},
    "quarantine": [{"cases": "*", "reason": "x", "until": "2026-12-31"}],
    "suspend": True,
}
IMAGES = [f"lane:{number}" for number in range(10)]


@dataclass
class FakeCluster:
    """Runs a job at once: in the case a-1 an image does what its outcomes say, round by round."""

    folder: Path
    outcomes: dict[str, str]
    jobs: dict[str, Json] = field(default_factory=dict)
    made: list[Json] = field(default_factory=list)
    interrupts: str = ""
    refuses: bool = False
    keeps: bool = False
    # What the status of a job says at its end beside its results; all of it without results.
    end: Json = field(default_factory=dict)
    gone: bool = False

    def create(self, job: Json) -> Json:
        name, image = job["metadata"]["name"], job["spec"]["stack"]["image"]
        if self.refuses:
            raise ClusterError("you may not create jobs", status=403)
        self.jobs[name] = job
        self.made.append(job)
        if image == self.interrupts:
            os.kill(os.getpid(), signal.SIGTERM)
        return job

    def job(self, name: str) -> Json:
        if self.gone:
            raise ClusterError("there is no job of that name", status=404)
        if self.end:
            return ended(**self.end)
        image = self.jobs[name]["spec"]["stack"]["image"]
        number = sum(each["spec"]["stack"]["image"] == image for each in self.made)
        does = self.outcomes[image]
        outcome = {"P": "passed", "F": "failed", "I": "invalid", "E": "errored"}.get(
            does[(number - 1) % len(does)]
        )
        if outcome is None:  # it never ends
            return a_job(name=name)
        rows = [make_row("a-0", "failed", "Other"), make_row("a-1", outcome, "Why")]
        kept = publish(self.folder, rows, uid=name)
        return ended("Failed", results=f"pvc://results/{kept.relative_to(self.folder)}")

    def changes(self, _name: str, _version: str, _seconds: float) -> Iterator[tuple[str, Json]]:
        return iter(())

    def delete(self, name: str) -> None:
        if self.keeps:
            raise ClusterError("you may not delete jobs", status=403)
        self.jobs.pop(name, None)


def outcomes(text: str) -> dict[str, str]:
    """A letter for each image, the oldest first; * for one that disagrees with itself."""
    return dict(zip(IMAGES, ("PF" if letter == "*" else letter for letter in text), strict=False))


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeCluster:
    made = FakeCluster(tmp_path, outcomes("PPPPPPFFFF"))
    monkeypatch.setattr(Place, "cluster", lambda _self: made)
    return made


def bisect(cluster: FakeCluster, *words: str, spec: Json = SPEC, **ends: str) -> Result:
    manifest = {
        "apiVersion": "sim.bagpipe.io/v1alpha1",
        "kind": "SimulationJob",
        "metadata": {"name": "lane-keeping-of-the-long-highway-no-17"},
        "spec": spec,
    }
    job, images = cluster.folder / "job.yaml", cluster.folder / "images"
    job.write_text(yaml.safe_dump(manifest))
    images.write_text("# of this week\n" + "\n".join(IMAGES[1:-1]) + "\n")
    given = {"good": IMAGES[0], "bad": IMAGES[-1], "images": str(images), "case": "a-1"} | ends
    options = [word for name, value in given.items() for word in (f"--{name}", value)]
    volume = ["--volume", f"results={cluster.folder}"]
    return CliRunner().invoke(main, ["bisect", str(job), *options, *volume, *words])


def test_the_first_bad_image_is_found_and_no_job_is_left(cluster: FakeCluster) -> None:
    result = bisect(cluster, "--output", "json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["firstBad"] == ["lane:6"]
    assert found["message"] == "lane:6 is the first bad one: lane:5, the one before it, is good"
    looked = [job["spec"]["stack"]["image"] for job in cluster.made]
    assert looked == ["lane:0", "lane:9", "lane:4", "lane:6", "lane:5"]
    words = {each["image"]: each["word"] for each in found["tried"]}
    assert words == {
        "lane:0": "good", "lane:4": "good", "lane:5": "good", "lane:6": "bad", "lane:9": "bad",
    }  # fmt: skip
    assert all(Path(cluster.folder, each["results"][0][14:]).is_dir() for each in found["tried"])
    assert cluster.jobs == {}


def test_each_job_is_one_of_its_own_that_goes_by_itself(cluster: FakeCluster) -> None:
    bisect(cluster, "--timeout", "20m")
    names = [job["metadata"]["name"] for job in cluster.made]
    assert len(set(names)) == len(names)
    assert max(map(len, names)) <= 40
    for job in cluster.made:
        spec = job["spec"]
        assert not {"baseline", "quarantine", "suspend"} & spec.keys()
        assert (spec["activeDeadline"], spec["ttlAfterFinished"]) == ("1200s", "1h")
        assert spec["stack"]["command"] == ["run"]


def test_what_can_t_be_judged_is_named_beside_the_first_bad_one(cluster: FakeCluster) -> None:
    cluster.outcomes = outcomes("PPPEEIFFFF")
    result = bisect(cluster)
    assert result.exit_code == 1
    assert "the first bad one is one of 4: lane:3, lane:4, lane:5, lane:6." in result.stdout
    assert "lane:2 is good, lane:6 is bad, and what is between can't be judged" in result.stdout
    assert cluster.jobs == {}


@pytest.mark.parametrize(
    ("end", "sentence"),
    [
        (
            {"verdict": "", "reason": "StackImageUnavailable", "results": ""},
            "left no results: StackImageUnavailable: 4 of 4 cases ran",
        ),
        (
            {"verdict": "", "reason": "StorageFailed", "results": "pvc://results/gone"},
            "StorageFailed: 4 of 4 cases ran; there is no pvc://results/gone/manifest.json",
        ),
        (
            {"verdict": "Failed", "results": "pvc://results/gone"},
            "can't be judged: there is no pvc://results/gone/manifest.json",
        ),
        ({"verdict": "Failed", "results": "pvc://other/gone"}, "give --volume other=FOLDER"),
    ],
)
def test_a_job_whose_results_are_not_there_says_why(
    cluster: FakeCluster, end: Json, sentence: str
) -> None:
    cluster.end = end
    result = bisect(cluster)
    assert result.exit_code == 2
    assert sentence.removeprefix("can't be judged: ") in result.stderr
    assert ("cases ran; there is no" in result.stderr) == ("cases ran; there is no" in sentence)
    assert cluster.jobs == {}


def test_a_job_that_somebody_else_deleted_says_so(cluster: FakeCluster) -> None:
    cluster.gone = True
    result = bisect(cluster)
    assert (result.exit_code, "there is no job of that name" in result.stderr) == (2, True)


def test_a_job_that_can_t_be_deleted_is_named(cluster: FakeCluster) -> None:
    cluster.keeps = True
    result = bisect(cluster)
    assert result.exit_code == 0
    for name in cluster.jobs:
        assert f"job {name} is left in the cluster: you may not delete jobs" in result.stderr


def test_rounds_end_where_they_disagree(cluster: FakeCluster) -> None:
    cluster.outcomes = outcomes("*PPPPPPPPF")
    bisect(cluster, "--rounds", "5")
    looked = [job["spec"]["stack"]["image"] for job in cluster.made]
    assert looked == ["lane:0"] * 2 + ["lane:9"] * 5


@pytest.mark.parametrize(
    ("metadata", "begins"),
    [
        ({"name": "lane"}, "lane-"),
        ({"generateName": "nightly-"}, "nightly-"),
        ({"name": "a" * 31 + "-" + "b" * 20}, "a" * 31 + "-"),
        ({"name": "a" * 50}, "a" * 31 + "-"),
        ({}, "bisect-"),
    ],
)
def test_a_job_s_name_is_a_new_one_of_at_most_40_letters(metadata: Json, begins: str) -> None:
    job = {"metadata": metadata, "spec": {"stack": {"image": "i"}}}
    names = [job_of(job, "lane:1", 60)["metadata"]["name"] for _ in range(2)]
    assert len(set(names)) == 2
    for name in names:
        assert name.startswith(begins)
        assert len(name) == len(begins) + 8
    assert job == {"metadata": metadata, "spec": {"stack": {"image": "i"}}}


@pytest.mark.parametrize(
    ("seconds", "deadline"), [(0.2, "1s"), (90, "90s"), (999_999, "999999s"), (1_000_000, None)]
)
def test_a_job_ends_by_itself(seconds: float, deadline: str | None) -> None:
    spec = job_of({"metadata": {}, "spec": {"stack": {}}}, "lane:1", seconds)["spec"]
    assert (spec.get("activeDeadline"), spec["ttlAfterFinished"]) == (deadline, "1h")
    own = {"stack": {}, "activeDeadline": "5m", "ttlAfterFinished": "0s"}
    kept = job_of({"metadata": {}, "spec": own}, "lane:1", seconds)["spec"]
    assert (kept["activeDeadline"], kept["ttlAfterFinished"]) == ("5m", "0s")


def test_nobody_is_notified_of_a_look_and_no_look_runs_in_a_pod_of_another() -> None:
    spark = {"executors": 2, "pool": "lane"}
    job = {"metadata": {}, "spec": {"stack": {}, "notify": ["all"], "spark": spark}}
    spec = job_of(job, "lane:1", 60)["spec"]
    assert ("notify" in spec, spec["spark"]) == (False, {"executors": 2})
    assert job["spec"]["spark"] == {"executors": 2, "pool": "lane"}


def test_what_nohup_ignores_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruptible():
            os.kill(os.getpid(), signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_an_image_that_disagrees_with_itself_can_t_be_judged(cluster: FakeCluster) -> None:
    cluster.outcomes = outcomes("PPPPPP*FFF")
    result = bisect(cluster, "--rounds", "2", "--output", "json")
    found = json.loads(result.stdout)
    assert (result.exit_code, found["firstBad"]) == (1, ["lane:6", "lane:7"])
    [flaky] = [each for each in found["tried"] if each["image"] == "lane:6"]
    assert flaky["why"].startswith("1 of 2 rounds passed: it flakes here")
    assert len(flaky["results"]) == 2


@pytest.mark.parametrize(
    ("text", "sentence", "looks"),
    [
        ("FFFFFFFFFF", "the good end fails as well", 2),
        ("PPPPPPPPPP", "the bad end passes", 2),
        ("PPPPPPPPPI", "the bad end can't be judged", 2),
    ],
)
def test_ends_that_are_not_what_they_are_called_end_the_search(
    cluster: FakeCluster, text: str, sentence: str, looks: int
) -> None:
    cluster.outcomes = outcomes(text)
    result = bisect(cluster)
    assert (result.exit_code, len(cluster.made)) == (2, looks)
    assert sentence in result.stdout
    assert "first bad one" not in result.stdout


def test_an_interruption_deletes_the_job_and_shows_what_was_tried(cluster: FakeCluster) -> None:
    cluster.interrupts = "lane:4"
    result = bisect(cluster, "--output", "json")
    assert result.exit_code == 130
    found = json.loads(result.stdout)
    assert [each["word"] for each in found["tried"]] == ["good", "unknown", "bad"]
    assert (found["firstBad"], found["message"]) == ([], "interrupted")
    assert cluster.jobs == {}
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_a_job_that_does_not_end_is_given_up_and_deleted(cluster: FakeCluster) -> None:
    cluster.outcomes = outcomes("?........F")
    result = bisect(cluster, "--timeout", "0.05s")
    assert result.exit_code == 2
    assert "has not ended within 0.05 s" in result.stderr
    assert cluster.jobs == {}


def test_a_case_that_no_job_has_says_so(cluster: FakeCluster) -> None:
    result = bisect(cluster, case="night-*")
    assert result.exit_code == 2
    assert "the job has no case night-*" in result.stderr


def test_a_name_without_a_case_beside_one_that_passes_is_not_good(cluster: FakeCluster) -> None:
    result = bisect(cluster, "--case", "b-0")
    assert result.exit_code == 2
    assert "lane:0 is unknown: the job has no case b-0" in result.stderr


def test_a_job_that_lost_a_case_is_not_good(
    cluster: FakeCluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = FakeCluster.job

    def job(self: FakeCluster, name: str) -> Json:
        found = whole(self, name)
        folder = self.folder / found["status"]["results"].removeprefix("pvc://results/")
        manifest = json.loads((folder / "manifest.json").read_text())
        manifest["counts"]["planned"] += 1
        (folder / "manifest.json").write_text(json.dumps(manifest))
        return found

    monkeypatch.setattr(FakeCluster, "job", job)
    result = bisect(cluster)
    assert result.exit_code == 2
    assert "lane:0 is unknown: 1 of 2 cases gave a result" in result.stderr


def test_a_refusal_of_the_cluster_is_the_last_word(cluster: FakeCluster) -> None:
    cluster.refuses = True
    result = bisect(cluster)
    assert (result.exit_code, "you may not create jobs" in result.stdout) == (2, True)


@pytest.mark.parametrize(
    ("ends", "spec", "sentence"),
    [
        ({"bad": "lane:0"}, SPEC, "are the same image"),
        ({"images": "/nowhere"}, SPEC, "can't be read"),
        ({}, SPEC | {"variants": [{"name": "a"}]}, "leave spec.variants out"),
        ({}, SPEC | {"output": {"uri": "pvc://other/out"}}, "give --volume other=FOLDER"),
        ({}, SPEC | {"stack": {}}, "spec.stack is missing"),
    ],
)
def test_what_can_t_be_searched_is_refused_before_anything_runs(
    cluster: FakeCluster, ends: dict[str, str], spec: Json, sentence: str
) -> None:
    result = bisect(cluster, spec=spec, **ends)
    assert (result.exit_code, sentence in result.output) == (2, True), result.output
    assert cluster.made == []


def test_one_end_alone_is_a_mistake(cluster: FakeCluster) -> None:
    job = cluster.folder / "job.yaml"
    result = CliRunner().invoke(main, ["bisect", str(job), "--case", "a", "--good", "lane:0"])
    assert (result.exit_code, "go together" in result.output) == (129, True)


def test_the_ends_may_be_in_the_list_and_what_lies_outside_is_left_out() -> None:
    listed = ["a", "b", "c", "d", "e"]
    assert images_between("b", "d", listed) == ["b", "c", "d"]
    assert images_between("x", "c", listed) == ["x", "a", "b", "c"]
    assert images_between("x", "y", []) == ["x", "y"]
    with pytest.raises(RefusedError, match="--bad before --good"):
        images_between("d", "b", listed)
    with pytest.raises(RefusedError, match="has b twice"):
        images_between("a", "c", ["a", "b", "b"])


def test_output_is_the_same_as_yaml(cluster: FakeCluster) -> None:
    found: Any = yaml.safe_load(bisect(cluster, "--output", "yaml").stdout)
    assert found["firstBad"] == ["lane:6"]
