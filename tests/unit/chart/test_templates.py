"""charts/bagpipe/tests: a suite for each template, run by helm-unittest without a cluster."""

import subprocess
from pathlib import Path

import pytest
from embedded import builds

CHART = Path(__file__).parents[3] / "charts" / "bagpipe"


def test_every_template_has_a_suite() -> None:
    templates = [p for p in (CHART / "templates").rglob("*") if p.is_file()]
    wanted = {p.stem.lower() for p in templates if not p.name.startswith("_")}
    suites = {p.name.removesuffix("_test.yaml") for p in (CHART / "tests").glob("*_test.yaml")}
    assert wanted == suites


@pytest.mark.timeout(900)  # the first run builds the program from its Go modules
def test_the_suites() -> None:
    program = builds.ensure(builds.CHART_TESTS) / "helm-unittest"
    done = subprocess.run(
        [program, "--strict", "--color=false", str(CHART)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
