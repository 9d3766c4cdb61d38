"""`bagpipe watch` in a real terminal: one block that is drawn again."""

import re

from tests.integration.control_plane.cli_process import CliProcess
from tests.integration.control_plane.client import Client, jobs
from tests.integration.control_plane.observe import a_job
from tests.integration.control_plane.server import ControlPlane
from tests.integration.control_plane.test_cli import RUNNING, report, report_end

# What moves the cursor to an earlier line: without it nothing is drawn again.
UP = re.compile(rb"\x1b\[\d*A")


def seconds(written: str) -> set[str]:
    """The seconds that were shown; a busy machine leaves some out."""
    return set(re.findall(r"watched for (\d+ s)", written))


def test_a_terminal_shows_one_block_that_is_drawn_again(
    control_plane: ControlPlane, admin: Client, namespace: str
) -> None:
    admin.create(jobs(namespace), a_job("lane"))
    report(admin, namespace, "lane", RUNNING, phase="Running", cases={"planned": 4, "passed": 1})
    words = ("watch", "lane", "-n", namespace, "--timeout", "300s")
    with CliProcess(control_plane.kubeconfig, *words, terminal=True) as terminal:
        terminal.read_until("25 % 1 of 4 cases")
        # Nothing changes in the cluster, and the seconds go on: the clock alone draws it again.
        terminal.read_until_that("three seconds", lambda written: len(seconds(written)) >= 3)
        assert UP.search(terminal.written)
        failure = {"case": "a-3", "reason": "TooSlow", "message": "9 Hz"}
        counts = {"planned": 4, "passed": 2, "failed": 1}
        report(admin, namespace, "lane", RUNNING, phase="Running", cases=counts, failures=[failure])
        terminal.read_until("75 % 3 of 4 cases")
        terminal.read_until("a-3: TooSlow: 9 Hz")
        report_end(admin, namespace, "lane", "Failed")
        assert terminal.end() == 1
        # The API server merges: the failed case that was reported before is there still.
        assert "Failed: 1 failed  lane: It ended." in terminal.plain()
        # The terminal is left as it was found: with a cursor.
        assert terminal.written.rfind(b"\x1b[?25h") > terminal.written.rfind(b"\x1b[?25l")
