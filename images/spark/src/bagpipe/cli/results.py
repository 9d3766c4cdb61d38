"""`bagpipe results`: what became of a job, and why its cases failed."""

from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from bagpipe.cli.cluster.place import Place, place_options, results_places
from bagpipe.cli.cluster.results_of import results_of
from bagpipe.cli.places import (
    RefusedError,
    folders,
    output_option,
    print_as,
    status_of,
    volume_option,
)
from bagpipe.cli.terminal import unstyled
from bagpipe.quarantine import remarks
from bagpipe.report.junit import kept, write_junit
from bagpipe.report.provenance import facts_of
from bagpipe.report.stored import StoredResults
from bagpipe.row_facts import discarded_count, discarded_of, quarantine_words, verdict_words
from bagpipe.storage import StorageError

_MOST_ROWS = 40
_COLOURS = {"passed": "green", "failed": "red", "invalid": "yellow", "errored": "magenta"}
# Of the provenance, what says which cases these are.
_SHOWN = frozenset({"catalogue"})
_KEPT = (
    "case", "outcome", "reason", "message", "variant", "values", "seed", "round", "seconds",
    "attempts", "starts", "quarantine",
)  # fmt: skip


@click.command("results")
@click.argument("where", metavar="RESULTS", shell_complete=results_places)
@place_options
@volume_option
@output_option
@click.option("--failed", is_flag=True, help="Only the cases that did not pass.")
@click.option(
    "--junit",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write all cases as tests into this file too, for a CI.",
)
def results_command(
    where: str,
    place: Place,
    volumes: tuple[str, ...],
    output: str,
    failed: bool,
    junit: Path | None,
) -> None:
    """Show the verdict of a job, and its cases.

    RESULTS is job/NAME for a job in the cluster (NAME alone after -n), the URI in the job's
    status.results, or a folder of this machine. A table shows the first 40 cases. The exit status
    is 0 if the verdict is Passed, 1 if it is another, and 2 if there is none.

    \b
    bagpipe results job/nightly -n robots --junit junit.xml
    bagpipe results s3://results/lane/nightly/0c1f...
    bagpipe results ./results --failed --output json | jq '.cases[].message'
    """
    try:
        stored = results_of(place, where, folders(volumes))
        found = describe(stored, failed)
        if junit is not None:
            _write_junit(stored, junit)
    except StorageError as error:
        raise RefusedError(str(error)) from error
    print_results(found, output)
    raise SystemExit(status_of(found))


def print_results(found: dict[str, Any], output: str) -> None:
    """Write what `describe` gives to stdout, as table, json or yaml."""
    if output == "table":
        _show(found, Console(emoji=False))
    else:
        print_as(found, output)


def describe(stored: StoredResults, failed: bool) -> dict[str, Any]:
    """The verdict, the counts, and the cases or those that did not pass. Raises StorageError."""
    manifest = stored.manifest()
    found = {
        key: manifest[key]
        for key in ("job", "phase", "reason", "verdict", "message", "counts", "ledger")
    }
    found["provenance"] = manifest.get("provenance") or {}
    found["comparisons"] = stored.comparisons()
    found["quarantine"] = manifest.get("quarantine")
    found["cases"] = [
        {key: row.get(key) for key in _KEPT}
        | {"discarded": discarded_of(row), "criteria": _figures(row)}
        for row in stored.rows()
        if not failed or row["outcome"] != "passed"
    ]
    return found


def _figures(row: dict[str, Any]) -> list[dict[str, Any]]:
    """The findings without their courses over time, which are for drawing."""
    return [
        {key: value for key, value in finding.items() if key != "course"}
        for finding in row.get("criteria") or []
    ]


def _write_junit(stored: StoredResults, target: Path) -> None:
    """All cases, as the job's own junit.xml has them. Raises StorageError and RefusedError."""
    manifest, rows = stored.manifest(), [kept(row) for row in stored.rows()]
    try:
        with target.open("wb") as file:
            write_junit(file, manifest, rows)
    except OSError as error:
        raise RefusedError(f"{target} can't be written: {error.strerror}") from error


def _show(found: dict[str, Any], console: Console) -> None:
    job, cases = found["job"], found["cases"]
    verdict = found["verdict"] or "no verdict"
    colour = {"Passed": "green", "Invalid": "yellow"}.get(verdict, "red")
    words = verdict_words(found["verdict"], found["counts"])
    console.print(f"[bold {colour}]{unstyled(words)}[/]  {unstyled(str(job['name']))}")
    console.print(unstyled(str(found["message"])), highlight=False)
    for name, value in facts_of(found):
        if name in _SHOWN:
            console.print(unstyled(f"{name}: {value}"), highlight=False)
    if runs := found["counts"]["discarded"]:
        why = found["provenance"].get("discarded") or {}
        reasons = ", ".join(f"{count} {reason}" for reason, count in why.items())
        noun = "1 run does" if runs == 1 else f"{runs:,} runs do"
        console.print(unstyled(f"{noun} not count: {reasons or 'executors were lost'}"),
                      highlight=False)  # fmt: skip
    for comparison in found["comparisons"]:
        name = comparison["variant"] or "this job"
        console.print(
            unstyled(f"{name} is {comparison['verdict']}: {comparison['message']}"), highlight=False
        )
    for words in remarks(found["quarantine"]):
        console.print(unstyled(words), highlight=False)
    console.print()
    table = Table(box=None, header_style="bold")
    for column in ("Case", "Outcome", "Seconds", "Discarded", "Why"):
        right = column in ("Seconds", "Discarded")
        table.add_column(column, overflow="fold", justify="right" if right else "left")
    for case in cases[:_MOST_ROWS]:
        outcome = str(case["outcome"])
        seconds = "" if case["seconds"] is None else f"{case['seconds']:.1f}"
        why = str(case["message"] or case["reason"] or "")
        why = "; ".join(words for words in (quarantine_words(case), why) if words)
        colour = _COLOURS.get(outcome, "red")
        table.add_row(
            unstyled(str(case["case"])), f"[{colour}]{unstyled(outcome)}[/]", seconds,
            str(discarded_count(case) or ""), unstyled(why),
        )  # fmt: skip
    console.print(table)
    if len(cases) > _MOST_ROWS:
        console.print(f"... and {len(cases) - _MOST_ROWS} more (--output json has all)")
