"""What a recording has in its names reaches no terminal as commands."""

import io

from rich.console import Console

from bagpipe.cli import bag
from bagpipe.cli.showing import Showing
from tests.unit.cli.test_words_of_a_stack import EVIL


def console_into(written: io.StringIO) -> Console:
    return Console(file=written, force_terminal=True, emoji=False, color_system=None)


def test_bag_info_shows_topics_and_obeys_none() -> None:
    written = io.StringIO()
    found = {
        "bag": "a.bag", "bytes": 1, "chunks": 1, "seconds": None, "compressions": ["none"],
        "messages": 1, "damage": None, "advice": "",
        "topics": [{"topic": f"/x{EVIL}", "messages": 1, "type": f"T{EVIL}"}],
    }  # fmt: skip
    bag._show_info(found, console_into(written))
    assert "\x1b" not in written.getvalue()


def test_bag_check_shows_problems_and_obeys_none() -> None:
    written = io.StringIO()
    checked = {"state": "damaged", "bag": f"a{EVIL}.bag", "messages": 1, "problems": [EVIL]}
    bag._show_checked([checked], console_into(written))
    assert "\x1b]52" not in written.getvalue()


def test_a_run_shows_a_warning_and_obeys_none() -> None:
    """It names a file of the volume, whatever that is called."""
    written = io.StringIO()
    console = Console(file=written, force_terminal=False, color_system=None)
    progress = {
        "phase": "Complete", "warning": f"pvc://r/{EVIL}.bag can't be read",
        "cases": {"planned": 1, "running": 0, "passed": 1, "failed": 0, "invalid": 0, "errored": 0},
    }  # fmt: skip
    with Showing(console, 1) as showing:
        showing.show(progress)
    assert "\x1b" not in written.getvalue()
