"""The charts' tests: a suite for each template, run by helm-unittest without a cluster."""

import subprocess
from pathlib import Path

import pytest
from embedded import builds

CHARTS = [Path(__file__).parents[3] / "charts" / name for name in ("bagpipe", "bagpipe-namespace")]


@pytest.mark.parametrize("chart", CHARTS, ids=lambda chart: chart.name)
def test_every_template_has_a_suite(chart: Path) -> None:
    templates = [p for p in (chart / "templates").rglob("*") if p.is_file()]
    wanted = {p.stem.lower() for p in templates if not p.name.startswith("_")}
    suites = {p.name.removesuffix("_test.yaml") for p in (chart / "tests").glob("*_test.yaml")}
    assert wanted == suites


@pytest.mark.parametrize("chart", CHARTS, ids=lambda chart: chart.name)
def test_the_suites(chart: Path) -> None:
    program = builds.ensure(builds.CHART_TESTS) / "helm-unittest"
    done = subprocess.run(
        [program, "--strict", "--color=false", str(chart)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
