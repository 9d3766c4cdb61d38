"""`bagpipe history`: many runs beside each other."""

import fnmatch
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from bagpipe.cli.list import results_below
from bagpipe.cli.places import (
    RefusedError,
    folders,
    output_option,
    print_as,
    uri_of,
    volume_option,
)
from bagpipe.cli.terminal import plain
from bagpipe.history.findings import CriterionHistory, History, history_of
from bagpipe.history.page import page
from bagpipe.history.run import Run, read_run
from bagpipe.storage import Storage, StorageError

_NAMED = 3
# Cases and findings of all runs together, of some two hundred bytes each.
_MOST_VALUES = 20_000_000
_MOST_NOTES = 20


@click.command("history")
@click.argument("where", metavar="FOLDER", default=".")
@click.option(
    "--job", "jobs", default="*", metavar="NAME", help="Only jobs of this name or pattern."
)
@click.option(
    "--last",
    type=click.IntRange(1, 400),
    default=60,
    show_default=True,
    help="So many runs, the newest ones.",
)
@click.option(
    "--page",
    "target",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write a page of it here, such as history.html.",
)
@volume_option
@output_option
def history_command(
    where: str, jobs: str, last: int, target: Path | None, volumes: tuple[str, ...], output: str
) -> None:
    """Show each criterion over the runs whose results lie below FOLDER.

    FOLDER is a folder of this machine or a URI, such as the output.uri of a schedule. Of each run
    results.parquet is read where it lies. A criterion is worse where a larger share of cases fails
    since some run, by more than chance explains, and still does: Fisher's exact test of all cases
    before and since, at 1 % over all runs together; a case that is in quarantine in its last run is
    left out of all runs, and listed. Figures are others where the medians of runs are since some
    run, by the test of Mann and Whitney at the same level.

    The exit status is 0 if nothing got worse, 1 if something did, and 2 if nothing can be read.

    \b
    bagpipe history bagpipe-results
    bagpipe history s3://results/nightly --job 'nightly-*' --last 30 --page history.html
    bagpipe history pvc://results/lane --volume results=/mnt/results --output json
    """
    try:
        known = folders(volumes)
        history, skipped = _read(uri_of(where, known), Storage(known), jobs, last)
        if target is not None:
            target.write_text(page(history, f"History of {where}"), "utf-8", "replace")
    except StorageError as error:
        raise RefusedError(plain(str(error))) from error
    except OSError as error:
        raise RefusedError(f"{target} can't be written: {error.strerror}") from error
    for note in skipped:
        click.echo(f"note: {plain(note)}", err=True)
    if output == "table":
        _show(history, Console(emoji=False))
    else:
        print_as(_data(history), output)
    raise SystemExit(1 if history.regressions else 0)


def _read(uri: str, storage: Storage, jobs: str, last: int) -> tuple[History, list[str]]:
    """The newest runs that have ended, and what was passed over. Raises StorageError."""
    listed = results_below(uri, storage)
    found = [each for each in listed if each["ended"] and fnmatch.fnmatchcase(each["job"], jobs)]
    if not found:
        raise StorageError(f"{uri} has no results of a job {jobs} that has ended")
    skipped = list(_without_results(listed))
    runs: list[Run] = []
    left = _MOST_VALUES
    for each in found[:last]:
        try:
            runs.append(read_run(each, storage, left))
            left -= runs[-1].values
        except StorageError as error:
            skipped.append(str(error))
    if not runs:
        raise StorageError(skipped[-1])
    return history_of(sorted(runs, key=lambda run: run.ended)), skipped


def _without_results(listed: list[dict[str, Any]]) -> Iterator[str]:
    """Nights of which nothing is known are no good ones: each is named, or how many there are."""
    notes = [f"{each['results']}: {each['note']}" for each in listed if each["note"]]
    yield from notes[:_MOST_NOTES]
    if len(notes) > _MOST_NOTES:
        yield f"{len(notes) - _MOST_NOTES} more have no results that can be read"


def _data(history: History) -> dict[str, Any]:
    runs = history.runs

    def since(run: int | None) -> dict[str, str] | None:
        return None if run is None else {"ended": runs[run].ended, "results": runs[run].results}

    return {
        "runs": [
            {"ended": run.ended, "verdict": run.verdict, "results": run.results} for run in runs
        ],
        "criteria": [
            {
                "name": each.name,
                "unit": each.unit,
                "worse_since": since(each.worse),
                "moved_since": since(each.moved),
                "cases": list(each.cases),
                "judged": [night.judged for night in each.nights],
                "failed": [night.failed for night in each.nights],
                "median": [night.median for night in each.nights],
            }
            for each in history.criteria
        ],
        "flaky": [vars(each) for each in history.flaky],
        "quarantined": [vars(each) for each in history.quarantined],
        "slowest": [{"case": case, "seconds": seconds} for case, seconds in history.slowest],
    }


def _show(history: History, console: Console) -> None:
    runs = history.runs
    first = (
        f"{len(runs)} runs, {runs[0].ended[:10]} to {runs[-1].ended[:10]};"
        f" the last: {runs[-1].verdict or 'no verdict'}"
    )
    console.print(escape(plain(first)), highlight=False)
    table = Table(box=None, header_style="bold")
    for column in ("Criterion", "In the last run", "Change"):
        table.add_column(column, overflow="fold")
    for each in history.criteria:
        colour = "red" if each.worse is not None else "default"
        now = each.nights[-1]
        median = "" if now.median is None else f", median {now.median:.4g} {each.unit}".rstrip()
        table.add_row(
            f"[{colour}]{escape(plain(each.name))}[/]",
            escape(plain(f"{now.failed} of {now.judged} failed{median}")),
            escape(plain(_change(each, history))),
        )
    console.print(table)
    for flaky in history.flaky[:_NAMED]:
        console.print(
            escape(plain(f"flaky: {flaky.case}, {flaky.flips} changes in {flaky.of} steps")),
            highlight=False,
        )
    for kept in history.quarantined[:_NAMED]:
        end = ", so that it could end" if kept.passed == kept.of else ""
        shares = f"passed in {kept.passed} of {kept.of} runs{end}"
        console.print(escape(plain(f"{kept.case}, {kept.words}: {shares}")), highlight=False)
    for case, seconds in history.slowest[:_NAMED]:
        console.print(escape(plain(f"slow: {case}, {seconds:.1f} s")), highlight=False)


def _change(of: CriterionHistory, history: History) -> str:
    """What changed, as a sentence."""
    words = []
    if of.worse is not None:
        before, since = _share(of, 0, of.worse), _share(of, of.worse, len(of.nights))
        named = ", ".join(of.cases[:_NAMED]) + (", ..." if len(of.cases) > _NAMED else "")
        new = f"; new: {named}" if named else ""
        day = history.runs[of.worse].ended[:10]
        words.append(f"worse since {day}: {since} failed, {before} before{new}")
    if of.moved is not None:
        words.append(f"other figures since {history.runs[of.moved].ended[:10]}")
    return "; ".join(words)


def _share(of: CriterionHistory, begin: int, end: int) -> str:
    nights = of.nights[begin:end]
    return f"{sum(night.failed for night in nights)} of {sum(night.judged for night in nights)}"
