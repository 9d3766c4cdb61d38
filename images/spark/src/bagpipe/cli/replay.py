"""`bagpipe replay`: one case of a job once more, on this machine."""

import json
import tempfile
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from bagpipe.cli.cluster.place import Place, place_options, results_option
from bagpipe.cli.cluster.results_of import results_of
from bagpipe.cli.places import RefusedError, folders, output_option, print_as, volume_option
from bagpipe.cli.terminal import plain, unstyled
from bagpipe.engine.chosen import engine_of
from bagpipe.matrix.faults import MatrixError
from bagpipe.plan.case import Case
from bagpipe.report.stored import StoredResults
from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.run.laptop import (
    ReplayError,
    agent_program,
    local_spec,
    planned_case,
    serving_agent,
    write_fragment,
)
from bagpipe.source.chosen import source_of
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage, StorageError
from bagpipe.wire.session import SessionError


@click.command("replay")
@click.argument("case", metavar="CASE")
@results_option
@place_options
@volume_option
@click.option(
    "--agent", default="bagpipe-agent", show_default=True, help="The program bagpipe-agent."
)
@click.option(
    "--keep",
    type=click.Path(path_type=Path, file_okay=False),
    help="Where the fragment, the recording and row.json go.  [default: ./CASE]",
)
@click.option(
    "--only-fragment", is_flag=True, help="Write the fragment and say how to play it by hand."
)
@output_option
def replay_command(
    case: str,
    where: str,
    place: Place,
    volumes: tuple[str, ...],
    agent: str,
    keep: Path | None,
    only_fragment: bool,
    output: str,
) -> None:
    """Run one case of a job again on this machine, and judge it by the job's own criteria.

    It cuts the case's fragment from the recording, starts the stack's command here as the job
    did, plays, records and judges. So this machine must have what the stack's image has: the
    command, and for ROS 2 that it is sourced; run it inside of that image, or where the stack is
    built.
    The command is taken from job.json in RESULTS: replay results that you trust.

    The exit status is 0 if the case passes here, 1 if it does not, and 2 if it can't be run.

    \b
    bagpipe replay night-0004-s2-pr-812 --results job/nightly -n robots
    bagpipe replay night-0004-s2-pr-812 --results s3://results/lane/nightly/0c1f...
    bagpipe replay night-0004 --results ./results --volume recordings=/data --only-fragment
    """
    target = keep or Path(Path(case).name)
    try:
        stored = results_of(place, where, folders(volumes))
        row, spec = _wanted(stored, case)
        planned = planned_case(row, spec, stored.storage)
        target.mkdir(parents=True, exist_ok=True)
        fragment = write_fragment(planned, source_of(spec), stored.storage, target / "fragment")
        if only_fragment:
            _explain(planned, spec, stored.storage, fragment)
            return
        again = _run(planned, spec, stored.storage.volumes, agent, fragment)
    except (StorageError, ReplayError, MatrixError, SessionError) as error:
        raise RefusedError(str(error)) from error
    except OSError as error:
        raise RefusedError(f"{target} can't be written: {error.strerror}") from error
    (target / "row.json").write_text(json.dumps(again, indent=1))
    if output == "table":
        _show(row, again, fragment)
    else:
        print_as(again, output)
    raise SystemExit({"passed": 0, "errored": 2}.get(again["outcome"], 1))


def _wanted(stored: StoredResults, case: str) -> tuple[Row, SimulationJobSpec]:
    stored.manifest()
    spec = stored.spec()
    if spec is None:
        raise ReplayError(f"{stored.uri} has no job.json: the job was run by an older version")
    return stored.row(case), local_spec(spec)


def _run(
    case: Case, spec: SimulationJobSpec, volumes: dict[str, str], agent: str, fragment: Path
) -> dict[str, Any]:
    target = fragment.parent
    program = agent_program(agent)
    if program is None:
        raise ReplayError(
            f"there is no {agent} on this machine: give --agent, or see --only-fragment."
            f" {fragment} is written"
        )
    results = target.resolve().as_uri()
    with tempfile.TemporaryDirectory() as folder:
        shared = Path(folder, "shared")
        shared.mkdir()
        with serving_agent(program, shared, target / "agent.log"):
            return run_case(case, RunContext("laptop/replay", spec, volumes, results, str(shared)))


def _explain(case: Case, spec: SimulationJobSpec, storage: Storage, bag: Path) -> None:
    click.echo(plain(f"{bag} has the case's part of {case.bag}."))
    engine = engine_of(spec.stack.engine)
    for line in engine.by_hand(case, spec, source_of(spec), storage, bag):
        click.echo(plain(line))


def _show(before: Row, again: dict[str, Any], fragment: Path) -> None:
    console = Console(emoji=False)
    console.print(
        f"[bold]{again['outcome']}[/] here, {unstyled(str(before['outcome']))} in the job:"
        f" {unstyled(str(again['case']))}"
    )
    if again["message"]:
        console.print(unstyled(again["message"]), highlight=False)
    for finding in again.get("criteria") or []:
        console.print(
            unstyled(f"  {finding['name']}: {finding['outcome']}, {finding['message']}"),
            highlight=False,
        )
    for line in again.get("stderr") or []:
        console.print(unstyled(f"  stderr: {line}"), highlight=False)
    kept = f"{fragment.name}, row.json, {again['recorded'] or '-'}"
    console.print(unstyled(f"Kept in {fragment.parent}: {kept}"))
