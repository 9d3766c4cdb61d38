"""The first lines of docs/start.md: what they install is there, and what they show is shown."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from bagpipe.cli.__main__ import main

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs/start.md").read_text()


def test_the_program_comes_before_what_takes_long() -> None:
    assert PAGE.index("pip install") < PAGE.index("make demo")


def test_the_extras_are_the_package_s() -> None:
    project = tomllib.loads((ROOT / "images/spark/pyproject.toml").read_text())["project"]
    named = re.findall(r"pip install '\./images/spark\[(.*)\]'", PAGE)
    assert named
    known = set(project["optional-dependencies"])
    # `run` brings what `jobs` does, and runs them; only `run --spark` needs Spark.
    expected = [known - {"run", "spark"}, known - {"jobs", "spark"}]
    assert [set(extras.split(",")) for extras in named] == expected


def test_the_plan_is_the_one_on_the_page() -> None:
    (manifest,) = set(re.findall(r"bagpipe plan (\S+)", PAGE))
    ended = CliRunner().invoke(main, ["plan", str(ROOT / manifest)])
    assert ended.exit_code == 0, ended.output
    printed = [line.strip() for line in ended.output.splitlines()]
    shown = re.search(rf"bagpipe plan {re.escape(manifest)}\n\n(.*?)\n\n", PAGE, re.DOTALL)
    assert shown is not None
    lines = [line[4:] for line in shown[1].splitlines()]
    assert lines
    assert [line for line in lines if line != "..." and line not in printed] == []


WITHOUT_SPARK = """
import sys
sys.modules |= dict.fromkeys(("pyspark", "py4j", "pyarrow"))
from bagpipe.cli.__main__ import main
"""


@pytest.mark.parametrize(
    "words",
    [
        ["plan", "docs/examples/barrier-car/job.yaml"],
        *([verb, "--help"] for verb in ("bag", "results", "report", "compare", "logs", "submit")),
    ],
    ids=lambda words: words[0],
)
def test_what_runs_no_job_needs_no_spark(words: list[str]) -> None:
    program = f"{WITHOUT_SPARK}main({words!r})"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=60,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_a_plan_waits_for_nothing_that_only_playing_needs() -> None:
    program = "import sys, bagpipe.cli.plan; print({'numpy', 'rosbags'} & sys.modules.keys())"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout == "set()\n"
