"""A pull that is not whole does not end with 0."""

from pathlib import Path

from bagpipe.cli.pull import _copy
from bagpipe.cli.pulling.stored import StoredFolder
from bagpipe.cli.pulling.target import Origin, target_at
from bagpipe.storage import Storage
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish


def test_results_without_their_lines_are_not_pulled_whole(tmp_path: Path) -> None:
    """A driver that committed, and could not publish (StorageFailed) leaves a manifest alone."""
    folder = publish(tmp_path, [make_row("a", recorded=None)])
    for name in ("results.jsonl", "junit.xml", "report.html", "results.parquet"):
        (folder / name).unlink()
    origin = Origin("robots", "drive", "uid-1", f"file://{folder}")
    with target_at(tmp_path / "here", origin) as to:
        source = StoredFolder(f"file://{folder}", Storage({}))
        pulled = _copy(source, to, [], shown=False)
    # pull_command's exit status is 2 if this is not empty, else 0.
    assert (pulled.left_out, pulled.missing) == ([], ["results.jsonl"])
