"""`pip install` brings no native module: what reads no bag needs none, the rest says so."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.unit.bagpipe.bags import steady, write_bag

EXAMPLES = Path(__file__).parents[3] / "docs/examples"
RUN = """
import sys
sys.modules["bagpipe_bag"] = None
from bagpipe.cli.__main__ import main
main(sys.argv[1:], prog_name="bagpipe")
"""


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", RUN, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_a_plan_without_a_recording_is_shown() -> None:
    done = run("plan", str(EXAMPLES / "barrier-car/job.yaml"))
    assert done.returncode == 0, done.stderr
    assert "54 cases" in done.stdout


JOB = """
apiVersion: sim.bagpipe.io/v1alpha1
kind: SimulationJob
metadata: {name: lane}
spec:
  source: {bags: ["pvc://recordings/*.bag"], topics: [/scan], fragment: {length: 3s}}
  stack: {image: i, command: [c]}
  record: {topics: [/out]}
  output: {uri: "pvc://results/out"}
"""


@pytest.mark.parametrize(
    "arguments",
    [
        ("plan", "job.yaml", "--volume", "recordings=."),
        ("bag", "info", "a.bag"),
        ("bag", "check", "a.bag"),
    ],
    ids=["plan", "info", "check"],
)
def test_what_reads_a_bag_says_how_to_get_the_module(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_bag(Path("a.bag"), steady("/scan", 10, 50_000_000))
    Path("job.yaml").write_text(JOB)
    done = run(*arguments)
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    (sentence,) = done.stderr.splitlines()
    assert "needs the native module bagpipe_bag, which is not installed here" in sentence
    assert "`make wheels` in a checkout builds it for pip, `make venv` into .venv" in sentence
    assert "unexpected" not in sentence


def test_a_run_of_a_recording_is_refused_before_anything_starts(tmp_path: Path) -> None:
    (tmp_path / "job.yaml").write_text(JOB)
    results = tmp_path / "results"
    volume = ("--volume", f"recordings={tmp_path}")
    done = run("run", str(tmp_path / "job.yaml"), *volume, "--results", str(results))
    assert (done.returncode, results.exists()) == (2, False), done.stderr
    assert "reading a bag needs the native module bagpipe_bag" in done.stderr


def test_a_run_of_files_misses_no_module(tmp_path: Path) -> None:
    job = JOB.replace("[c]}", "[c], engine: exec}").replace("  record: {topics: [/out]}\n", "")
    recordings = 'bags: ["pvc://recordings/*.bag"], topics: [/scan], fragment: {length: 3s}'
    missed = {}
    for kind in ("files", "bags"):
        (tmp_path / "job.yaml").write_text(
            job.replace(recordings, f'{kind}: ["pvc://recordings/*"]')
        )
        volume = ("--volume", f"recordings={tmp_path}")
        done = run("run", str(tmp_path / "job.yaml"), *volume, "--agent", "no-such-agent")
        assert done.returncode == 2
        assert "there is no no-such-agent on this machine" in done.stderr
        missed[kind] = "reading a bag needs the native module" in done.stderr
    assert missed == {"files": False, "bags": True}


@pytest.mark.parametrize("verb", ["results", "report"])
def test_a_folder_without_results_is_reported_and_no_module_is_missed(
    verb: str, tmp_path: Path
) -> None:
    done = run(verb, str(tmp_path))
    assert done.returncode == 2
    assert "manifest.json" in done.stderr
    assert "bagpipe_bag" not in done.stderr
