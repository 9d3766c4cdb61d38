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


def test_a_driver_on_a_laptop_loads_no_spark() -> None:
    code = "import sys, bagpipe.driver.this_machine; print(*{'pyspark', 'py4j'} & set(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.split() == []
