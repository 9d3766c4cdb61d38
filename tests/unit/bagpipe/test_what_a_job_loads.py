"""Libraries that few jobs use are not loaded by those that don't: each costs every pod's start."""

import subprocess
import sys

import pytest

# scipy and vehiclemodels take longest, cel brings a shell with it, matplotlib is the report's.
SELDOM = {"cel", "matplotlib", "omegaconf", "pandas", "prompt_toolkit", "scipy", "vehiclemodels"}


@pytest.mark.parametrize(
    "module",
    ["bagpipe.driver.this_machine", "bagpipe.driver.cases_on_spark", "bagpipe.run.case_run"],
)
def test_what_few_jobs_use_is_not_loaded_by_all(module: str) -> None:
    code = f"import sys, {module}; print(*sorted({SELDOM!r} & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.split() == []


# What is waited for before the first case of a job on a laptop, and is needed later or never.
LATER = {"pyspark", "py4j", "numpy", "pyarrow", "jinja2"}


@pytest.mark.parametrize("module", ["bagpipe.cli.run", "bagpipe.driver.this_machine"])
def test_a_laptop_waits_for_nothing_that_its_first_case_does_without(module: str) -> None:
    code = f"import sys, {module}; print(*sorted({LATER!r} & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.split() == []


def test_the_server_of_the_slots_processes_is_started_before_anything_takes_time() -> None:
    code = "import sys, bagpipe.driver.slot_server, bagpipe.driver.streams; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    loaded = set(done.stdout.split())
    assert "bagpipe.driver.slot_server" in loaded
    assert loaded & {"pydantic", "yaml", "bagpipe.spec", "bagpipe.run.case_run"} == set()
