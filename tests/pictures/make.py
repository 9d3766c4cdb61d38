"""The documentation's pictures, made again: `make pictures`. They are no tests, and are looked at.

The dashboards show what a real Prometheus asked a real operator, driver and agent in some minutes,
of jobs on a fake kubelet; the report is of drawn figures.
"""

import json
import os
import time
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By

from bagpipe.run.case_run import Row
from tests.integration.chromium import screen
from tests.integration.control_plane.client import Client
from tests.integration.control_plane.due_schedules import start_run
from tests.integration.control_plane.fake_driver import fake_driver
from tests.integration.control_plane.fake_kubelet import FakeKubelet
from tests.integration.control_plane.observe import create_jobs, statuses
from tests.integration.control_plane.prometheus_server import Prometheus
from tests.integration.control_plane.test_dashboards import run_jobs
from tests.integration.report.drives import drive_rows, report_of
from tests.pictures.answers import answers
from tests.pictures.drawing import bundled, draw_board, photograph
from tests.unit.operator.builders import account
from tests.waiting import PATIENCE, wait_until

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "docs/pictures"
BOARDS = ROOT / "charts/bagpipe/files/dashboards"
# How long figures are collected, and how often a job begins meanwhile.
MINUTES = 4
PAUSE = 12
NIGHTS = {"lanes": "Passed", "pedestrians": "Failed", "stereo": "Passed"}
pytestmark = pytest.mark.timeout(1800)


@pytest.fixture
def packages() -> Path:
    """Where npm has put what the page is made of."""
    return Path(os.environ["BAGPIPE_PICTURES_PACKAGES"])


def test_dashboards(
    admin: Client, namespace: str, kubelet: FakeKubelet, prometheus: Prometheus, packages: Path,
    browser: webdriver.Chrome, tmp_path: Path,
) -> None:  # fmt: skip
    begun = time.time()
    run_jobs(admin, namespace, kubelet)
    run_nights(admin, namespace, kubelet)
    for number in range(MINUTES * 60 // PAUSE):
        run_one(
            admin,
            namespace,
            kubelet,
            f"lane-{number:02}",
            verdict="Failed" if number % 4 == 3 else "Passed",
        )
        time.sleep(PAUSE)
    ended = time.time()
    folder = tmp_path / "page"
    folder.mkdir()
    bundled(packages, folder)
    variables = {"namespace": namespace, "job_name": "drive", "schedule": ".*"}
    for path in sorted(BOARDS.glob("*.json")):
        board = json.loads(path.read_text())
        found = answers(prometheus, board, variables, begun, ended)
        draw_board(browser, folder, board, found, PICTURES / f"dashboard-{path.stem}.png")


def run_one(admin: Client, namespace: str, kubelet: FakeKubelet, name: str, verdict: str) -> None:
    """A job comes, runs and ends."""
    create_jobs(admin, namespace, [name])
    end(admin, namespace, kubelet, name, verdict)


def run_nights(admin: Client, namespace: str, kubelet: FakeKubelet) -> None:
    """Schedules start a job each, which end in different ways."""
    known = set(statuses(admin, namespace))

    def begun() -> set[str]:
        return set(statuses(admin, namespace)) - known

    for schedule, verdict in NIGHTS.items():
        start_run(admin, namespace, schedule)
        wait_until(lambda: bool(begun()), PATIENCE, f"no job of {schedule} has begun")
        (name,) = begun()
        known.add(name)
        end(admin, namespace, kubelet, name, verdict)


def end(admin: Client, namespace: str, kubelet: FakeKubelet, name: str, verdict: str) -> None:
    """A job's driver starts, counts, and ends with a verdict."""

    def phase() -> str:
        return str(statuses(admin, namespace)[name].get("phase", ""))

    wait_until(lambda: phase() == "Pending", PATIENCE, f"{name} is not pending")
    with fake_driver(account()) as driver:
        kubelet.run(namespace, f"{name}-1-driver", ip=driver.ip)
        wait_until(lambda: phase() == "Running", PATIENCE, f"{name} does not run")
    failed = 3 if verdict == "Failed" else 0
    counts = {"planned": 40, "passed": 40 - failed, "failed": failed, "regressed": failed}
    message = account("Complete", verdict=verdict, cases=counts)
    kubelet.end(namespace, f"{name}-1-driver", 0, message)
    wait_until(lambda: phase() == "Complete", PATIENCE, f"{name} does not end")


@pytest.mark.parametrize(
    ("name", "width", "height", "scheme"),
    [("report", 1280, 2200, "light"), ("report-dark", 1280, 1100, "dark"),
     ("report-phone", 412, 1100, "light")],
)  # fmt: skip
def test_report(
    browser: webdriver.Chrome, tmp_path: Path, name: str, width: int, height: int, scheme: str
) -> None:
    page = tmp_path / "report.html"
    rows = drive_rows(288)
    crashed = {pair(row) for row in rows if row["outcome"] == "errored"}
    rows = [row for row in rows if pair(row) not in crashed]
    for row in rows:
        row["bag"] = f"pvc://recordings/{row['fragment']}.bag"
    page.write_bytes(report_of(rows, "pvc://results/out/lane-nightly/u"))
    feature = {"name": "prefers-color-scheme", "value": scheme}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
    with screen(browser, width):
        browser.get(page.as_uri())
        drawn = "svg, canvas"
        wait_until(lambda: bool(browser.find_elements(By.CSS_SELECTOR, drawn)), PATIENCE, "")
        photograph(browser, PICTURES / f"{name}.png", height=height)


def pair(row: Row) -> tuple[Any, ...]:
    """What is the same in both variants."""
    return row["fragment"], row["scenario"]
