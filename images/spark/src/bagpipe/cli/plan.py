"""`bagpipe plan`: the cases of a job before anything runs."""

import dataclasses
import itertools
import json
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from bagpipe.cli.estimate import estimate, sentences
from bagpipe.cli.manifest import ManifestError, read_job
from bagpipe.cli.places import RefusedError, folders, print_as, results_at, volume_option
from bagpipe.cli.terminal import unstyled
from bagpipe.counted import counted
from bagpipe.matrix.expand import Expansion
from bagpipe.matrix.faults import MatrixError
from bagpipe.plan.conditions import crossing
from bagpipe.plan.expected import Earlier, earlier_of
from bagpipe.plan.made import Plan, Selection
from bagpipe.plan.variant import check_templates
from bagpipe.quarantine import planned
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec, claims
from bagpipe.storage import Storage, StorageError

# A table that nobody reads to its end; --output json has all.
_MOST_ROWS = 40


@click.command("plan")
@click.argument("manifest", type=click.Path(path_type=Path))
@volume_option
@click.option(
    "--output",
    type=click.Choice(["table", "json", "yaml"]),
    default="table",
    show_default=True,
    help="How the plan is written. A table shows the first 40 cases.",
)
@click.option(
    "--results",
    multiple=True,
    metavar="RESULTS",
    help="Earlier results, a folder or a URI, whose times and memory the estimate rests on. May be"
    " repeated.",
)
def plan_command(
    manifest: Path, volumes: tuple[str, ...], output: str, results: tuple[str, ...]
) -> None:
    """Show the cases of the SimulationJob in MANIFEST, what its rules left out, and an estimate.

    Of bags only the indexes are read. Numbers that are missing among a bag's fragments are of times
    in which nothing was recorded. Where bags can't be reached from here, such as those of a claim
    without --volume, the scenarios and variants of one fragment are shown.

    The estimate is of the time on the job's slots, as a range, and of the memory that an executor's
    stack container needs at least. It says what it rests on.

    \b
    bagpipe plan job.yaml
    bagpipe plan job.yaml --results bagpipe-results/lane
    bagpipe plan job.yaml --volume recordings=/data/recordings
    bagpipe plan job.yaml --output json | jq '.cases[].case'
    """
    try:
        name, spec = read_job(manifest)
        check_templates(spec)
        known = folders(volumes)
        stored = [results_at(where, known) for where in results]
        earlier = earlier_of(itertools.chain.from_iterable(each.rows() for each in stored))
        description = describe(name, spec, known, earlier)
    except (ManifestError, MatrixError, StorageError) as error:
        raise RefusedError(str(error)) from error
    if output == "table":
        _show(description, Console(emoji=False), spec.playback.mode)
    else:
        print_as(description, output)
    if description["unplanned"]:
        raise SystemExit(2)


def describe(
    name: str, spec: SimulationJobSpec, volumes: dict[str, str], earlier: Earlier
) -> dict[str, Any]:
    """The plan as data: `cases`, `excluded`, `unplanned`, and counts. Raises MatrixError.

    `fragments` and `estimate` are null when the recordings are not reachable from here; cases are
    then named as those of a fragment called `*`.
    """
    conditions = crossing(spec)
    missing = sorted(set(claims(spec)) - set(volumes) - _output_only(spec))
    made = plan(spec, Storage(volumes)) if not missing else None
    return {
        "job": name,
        "fragments": len({case.fragment for case in made.cases}) if made else None,
        "unreachable": missing,
        "conditions": len(conditions.named),
        "matrix": _matrix(conditions.expansion),
        "cases": _cases(made) if made else [
            {"case": f"*{suffix}", "variant": c.variant, "values": c.values, "seed": c.seed}
            for suffix, c in conditions.named
        ],
        "unplanned": [
            {"bag": bag.bag, "reason": bag.reason, "message": bag.message}
            for bag in (made.unplanned if made else [])
        ],
        "catalogue": dataclasses.asdict(made.selection) if made and made.selection else None,
        "quarantine": _quarantine(spec, made),
        "estimate": estimate(spec, made.cases, earlier) if made else None,
    }  # fmt: skip


def _quarantine(spec: SimulationJobSpec, made: Plan | None) -> dict[str, Any] | None:
    """What would be in quarantine today; None without rules, or where no case is known."""
    if not spec.quarantine or made is None:
        return None
    names = [case.id for case in made.cases] + [bag.id for bag in made.unplanned]
    return planned(spec.quarantine, names, datetime.now(UTC).date())


def _output_only(spec: SimulationJobSpec) -> set[str]:
    return {claim for claim, read_only in claims(spec).items() if not read_only} - {
        uri.removeprefix("pvc://").split("/", 1)[0]
        for uri in spec.source.uris
        if uri.startswith("pvc://")
    }


def _cases(made: Plan) -> list[dict[str, Any]]:
    return [
        {
            "case": case.id,
            "bag": case.bag,
            "variant": case.conditions.variant,
            "values": case.conditions.values,
            "seed": case.conditions.seed,
            "seconds": round((case.window.end - case.window.start) / 1e9, 3),
            "messages": case.messages,
            "bytes": case.bytes,
        }
        | case.pieces
        for case in sorted(made.cases, key=lambda case: case.id)
    ]


def _matrix(expansion: Expansion | None) -> dict[str, Any] | None:
    if expansion is None:
        return None
    return {
        "combinations": expansion.combinations,
        "scenarios": len(expansion.scenarios),
        "sampledOut": expansion.sampled_out,
        "excluded": [
            {"values": e.values, "when": e.when, "because": e.because} for e in expansion.excluded
        ],
    }


def _show(description: dict[str, Any], console: Console, mode: str) -> None:
    cases = description["cases"]
    names = list(dict.fromkeys(name for case in cases for name in case["values"]))
    table = Table(box=None, header_style="bold")
    table.add_column("Case")
    if any(case["variant"] for case in cases):
        table.add_column("Variant")
    for name in names:
        table.add_column(unstyled(name))
    if description["fragments"] is not None:
        for column in ("Seconds", "Messages", "Bytes"):
            table.add_column(column, justify="right")
    for case in cases[:_MOST_ROWS]:
        table.add_row(*_row(case, names, any(case["variant"] for case in cases)))
    console.print(table)
    if len(cases) > _MOST_ROWS:
        console.print(f"... and {len(cases) - _MOST_ROWS} more (--output json has all)")
    _show_parts(cases, console)
    _show_exclusions(description["matrix"], console)
    _show_sums(description, console)
    if description["estimate"] is not None:
        for line in sentences(description["estimate"], mode):
            console.print(line, markup=False, highlight=False, soft_wrap=True)


def _row(case: dict[str, Any], names: list[str], variants: bool) -> list[str]:
    row = [case["case"]] + ([case["variant"]] if variants else [])
    row = [unstyled(cell) for cell in [*row, *(str(case["values"].get(n, "")) for n in names)]]
    if "bytes" in case:
        row += [f"{case['seconds']:g}", f"{case['messages']:,}", f"{case['bytes']:,}"]
    return row


def _show_parts(cases: list[dict[str, Any]], console: Console) -> None:
    """What the cases are put together of: that of each is shown once."""
    shown: dict[str, tuple[str, list[dict[str, Any]]]] = {}
    for case in cases:
        if "parts" in case:
            shown.setdefault(json.dumps(case["parts"]), (case["case"], case["parts"]))
    for name, parts in list(shown.values())[:_MOST_ROWS]:
        title = f"Parts of {unstyled(name)}"
        table = Table(box=None, header_style="bold", title=title, title_justify="left")
        table.add_column("Bag", overflow="fold")
        for column in ("From", "To", "Played at"):
            table.add_column(column, justify="right")
        for part in parts:
            times = [*part["window"], part["at"]]
            table.add_row(unstyled(part["bag"]), *(f"{time / 1e9:.3f}" for time in times))
        console.print()
        console.print(table)


def _show_exclusions(matrix: dict[str, Any] | None, console: Console) -> None:
    if not matrix or not matrix["excluded"]:
        return
    by_rule: dict[tuple[str, str], int] = {}
    for excluded in matrix["excluded"]:
        key = (excluded["when"], excluded["because"])
        by_rule[key] = by_rule.get(key, 0) + 1
    table = Table(box=None, header_style="bold", title="Left out", title_justify="left")
    table.add_column("Combinations", justify="right")
    table.add_column("Rule")
    table.add_column("Because")
    for (when, because), count in by_rule.items():
        table.add_row(str(count), unstyled(when), unstyled(because) or "(no reason given)")
    console.print()
    console.print(table)


def _show_sums(description: dict[str, Any], console: Console) -> None:
    cases, fragments = len(description["cases"]), description["fragments"]
    if fragments is None:
        claims_missing = unstyled(", ".join(description["unreachable"]))
        console.print(
            f"\n{counted(cases, 'case')} for each fragment. The recordings of {claims_missing} are"
            " not on this machine: give --volume CLAIM=FOLDER to see the fragments."
        )
    else:
        console.print(
            f"\n{counted(cases, 'case')}: {counted(fragments, 'fragment')}, each under"
            f" {counted(description['conditions'], 'condition')}."
        )
    if found := description["catalogue"]:
        line = f"Selected: {Selection(**found).sentence}"
        console.print(unstyled(line), highlight=False, soft_wrap=True)
    if found := description["quarantine"]:
        console.print(f"{found['cases']} of them are in quarantine on {found['day']} (UTC).")
        for rule in found["rules"]:
            if rule["toDo"]:
                line = f"quarantine of {rule['cases']!r}: {rule['toDo']}"
                console.print(unstyled(line), highlight=False, soft_wrap=True)
    # A piece that is missing is so for each of its scenarios.
    alike = Counter((bag["reason"], bag["message"]) for bag in description["unplanned"])
    for (reason, message), count in alike.items():
        times = f" ({count} cases)" if count > 1 else ""
        console.print(f"[red]{unstyled(reason)}[/red] {unstyled(message)}{times}", soft_wrap=True)
