"""`bagpipe logs`: what was written in a case, or by a job's driver and executors."""

import click

from bagpipe.cli.cluster.place import Place, job_names, place_options
from bagpipe.cli.cluster.pod_logs import (
    AGENT,
    DRIVER,
    EXECUTOR,
    STACK,
    LogPart,
    driver_log,
    executor_logs,
    kept,
)
from bagpipe.cli.cluster.state import JobState, Json
from bagpipe.cli.places import folders, output_option, print_as, results_at, volume_option
from bagpipe.cli.terminal import plain
from bagpipe.driver.journal import Journal
from bagpipe.engine_fields import DEFAULT_ENGINE
from bagpipe.report.stored import StoredResults
from bagpipe.storage import StorageError


@click.command("logs")
@click.argument("name", metavar="JOB", shell_complete=job_names)
@click.argument("case", metavar="[CASE]", required=False)
@place_options
@click.option(
    "--of",
    type=click.Choice([STACK, AGENT, DRIVER, EXECUTOR]),
    help="Whose log.  [default: of a case the stack's and the agent's, else the driver's]",
)
@click.option(
    "--tail",
    type=click.IntRange(1, 20_000),
    default=200,
    show_default=True,
    help="At most so many lines of each part, the last ones.",
)
@volume_option
@output_option
def logs_command(
    name: str, case: str | None, place: Place, of: str | None, tail: int,
    volumes: tuple[str, ...], output: str,
) -> None:  # fmt: skip
    """Show what was written in one case of a job, or by its driver and executors.

    Of a case that has ended, the results keep how it ended and the last lines of the stack's stdout
    and stderr (50 lines or 8 KiB of each). If they can't be read from here, and for what the agent
    wrote, the logs of the executors' pods are searched for the case's lines; these go with the
    pods, at the latest when the job ends. Each part says where it comes from, or why it is
    missing.

    The exit status is 0 if there was anything to show, else 2.

    \b
    bagpipe logs nightly                           what the driver wrote
    bagpipe logs nightly drive-0003-s2 -n robots   what the stack and the agent wrote in a case
    bagpipe logs nightly drive-0003-s2 --of driver how it ended, and what else the driver says of it
    bagpipe logs nightly drive-0003-s2 --volume results=/mnt/results
    bagpipe logs nightly --of executor --tail 50
    """
    cluster = place.cluster()
    job = cluster.job(name.removeprefix("job/"))
    state = JobState.of(job)
    engine = str(((job.get("spec") or {}).get("stack") or {}).get("engine") or DEFAULT_ENGINE)
    parts: list[LogPart] = []
    wanted = [of] if of else [DRIVER] if case is None else [STACK, AGENT]
    if case is not None and STACK in wanted:
        parts = _kept(state, case, volumes)
        if any(part.of.startswith(STACK) and not part.missing for part in parts):
            wanted.remove(STACK)
    for each in wanted:
        if each == DRIVER:
            parts.append(driver_log(cluster, state, tail, case))
        else:
            parts += executor_logs(cluster, state, each, tail, case, engine)
    _show(parts, output)
    raise SystemExit(0 if any(part.lines for part in parts) else 2)


def _kept(state: JobState, case: str, volumes: tuple[str, ...]) -> list[LogPart]:
    """What the results keep of a case, or why nothing of them can be shown."""
    if not state.results:
        return [LogPart("outcome", "", missing="the job has no results yet")]
    try:
        stored = results_at(state.results, folders(volumes))
        row, where = _row(stored, case)
    except StorageError as error:
        return [LogPart("outcome", state.results, missing=str(error))]
    if row is None:
        return [LogPart("outcome", where, missing=f"case {case} has not ended, or there is none")]
    return kept(row, where)


def _row(stored: StoredResults, case: str) -> tuple[Json | None, str]:
    """The row of a case and where it stands: in results.jsonl, or before the end in the journal.

    Raises StorageError.
    """
    uri = f"{stored.uri}/results.jsonl"
    if stored.storage.exists(uri):
        return stored.row(case), uri
    rows = Journal(stored.storage, stored.uri, attempt=0).rows()
    return next((row for row in rows if row["case"] == case), None), f"{stored.uri}/journal"


def _show(parts: list[LogPart], output: str) -> None:
    if output != "table":
        print_as([part.as_json() for part in parts], output)
        return
    for part in parts:
        source = f" ({part.source})" if part.source else ""
        click.secho(f"== {plain(part.of)}{plain(source)}", bold=True)
        for line in part.lines:
            click.echo(plain(line))
        if not part.lines:
            click.echo(plain(f"   {part.missing or 'nothing was written'}"))
