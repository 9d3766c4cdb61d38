"""`bagpipe compare`: is this job better or worse than that one, on the cases that both have?"""

from collections.abc import Callable
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from bagpipe.cli.cluster.place import Place, place_options, results_places
from bagpipe.cli.cluster.results_of import results_of
from bagpipe.cli.places import RefusedError, folders, output_option, print_as, volume_option
from bagpipe.cli.terminal import plain, unstyled
from bagpipe.compare.compare import compare
from bagpipe.compare.gate import CAUSES, Cause, objections
from bagpipe.report.stored import StoredResults
from bagpipe.storage import StorageError

_Command = Callable[..., None]

_COLOURS = {"better": "green", "worse": "red", "unknown": "yellow"}

_ALLOW: dict[Cause, tuple[str, str]] = {
    "Regressed": (
        "--allow-regressed",
        "Cases that passed in BEFORE and fail, are invalid or errored now don't count.",
    ),
    "Missing": ("--allow-missing", "Cases of BEFORE that AFTER lacks don't count."),
    "WorseCriteria": ("--allow-worse-criteria", "Criteria with worse figures don't count."),
    "Unknown": (
        "--allow-unknown",
        "That no case, or not one that passes less often now, could be compared doesn't count.",
    ),
}


def _allow_options(command: _Command) -> _Command:
    """An option for each cause, for those who want less."""
    for cause, (option, sentence) in reversed(_ALLOW.items()):
        command = click.option(option, cause, is_flag=True, help=sentence)(command)
    return command


@click.command("compare")
@click.argument("before", metavar="BEFORE", shell_complete=results_places)
@click.argument("after", metavar="AFTER", shell_complete=results_places)
@_allow_options
@place_options
@volume_option
@output_option
def compare_command(
    before: str,
    after: str,
    place: Place,
    volumes: tuple[str, ...],
    output: str,
    **allow: bool,
) -> None:
    """Compare the results AFTER with the results BEFORE, case by case and criterion by criterion.

    Each is job/NAME for a job in the cluster (NAME alone after -n), a URI as in status.results, or
    a folder of this machine. Cases are the same if they have the same fragment, values and seed.
    The exit status is 1 if a variant of AFTER is worse or lacks cases of BEFORE, and 2 if no case
    could be compared, or not one that passes less often now. What is allowed is reported all the
    same.

    \b
    bagpipe compare job/nightly-41 job/nightly-42 -n robots
    bagpipe compare ./released ./pr-812
    bagpipe compare s3://results/nightly/a1... s3://results/nightly/b2... --output json
    """
    try:
        here = folders(volumes)
        found = compared(results_of(place, before, here), results_of(place, after, here))
    except StorageError as error:
        raise RefusedError(str(error)) from error
    if output == "table":
        for comparison in found:
            _show(comparison, Console(emoji=False))
    else:
        print_as(found, output)
    causes = {cause for cause in CAUSES if allow[cause]}
    against = [each for one in found for each in objections(one, causes)]
    for each in against:
        sentence = f"{each.message}: {_ALLOW[each.cause][0]} lets that pass"
        click.echo(plain(sentence), err=True)
    if found and not against:
        return
    raise SystemExit(1 if any(each.cause != "Unknown" for each in against) else 2)


def compared(before: StoredResults, after: StoredResults) -> list[dict[str, Any]]:
    """Each variant of `after` against the first of `before`. Raises StorageError."""
    for stored in (before, after):
        stored.head()
    rows = list(after.marked_rows())
    spec = after.spec()
    variants = [variant.name for variant in spec.variants] if spec else []
    variants = variants or list(dict.fromkeys(str(row.get("variant") or "") for row in rows))
    return [found.as_json() for found in compare(rows, variants, before.baseline_rows())]


def _show(comparison: dict[str, Any], console: Console) -> None:
    colour = _COLOURS.get(comparison["verdict"], "bold")
    name = comparison["variant"] or "the later job"
    console.print(f"[bold {colour}]{comparison['verdict']}[/]  {unstyled(name)}")
    console.print(unstyled(comparison["message"]), highlight=False)
    if comparison["criteria"]:
        table = Table(box=None, header_style="bold")
        for column in ("Criterion", "", "Before", "After", "Difference"):
            table.add_column(column)
        for criterion in comparison["criteria"]:
            verdict = criterion["verdict"]
            table.add_row(
                unstyled(criterion["name"]),
                f"[{_COLOURS.get(verdict, 'default')}]{verdict}[/]",
                _figure(criterion["baseline"]),
                _figure(criterion["variant"]),
                unstyled(criterion["message"]),
            )
        console.print(table)
    for case in comparison["regressed"]:
        why = f" ({case['reason']})" if case["reason"] else ""
        line = f"  regressed: {case['case']} is {case['to']} now{why}"
        console.print(unstyled(line), highlight=False)
    for case in comparison.get("quarantined") or []:
        line = f"  in quarantine: {case['case']} is {case['to']} now"
        console.print(unstyled(line), highlight=False)
    for word in ("fixed", "flaky", "missing"):
        for case in comparison[word]:
            console.print(f"  {word}: {unstyled(case)}", highlight=False)


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"
