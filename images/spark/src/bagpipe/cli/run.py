"""`bagpipe run`: the same job on this machine, without Kubernetes."""

import importlib.util
import math
import os
import shutil
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
from rich.markup import escape

from bagpipe.cli.here import (
    Machine,
    notes,
    of_variants,
    refusals,
    without_missing,
    without_schedule,
)
from bagpipe.cli.manifest import ManifestError, read_job, read_marks
from bagpipe.cli.places import (
    RefusedError,
    file_uri,
    folders,
    output_option,
    results_at,
    status_of,
    volume_option,
)
from bagpipe.cli.results import describe, print_results
from bagpipe.cli.run_folder import beginning, run_folder
from bagpipe.cli.running import Driver, RunError, run_here
from bagpipe.cli.showing import QuietConsole, Showing
from bagpipe.matrix.faults import MatrixError
from bagpipe.native import NativeModuleError, native
from bagpipe.run.laptop import ReplayError, agent_program, own_environment
from bagpipe.source_fields import source_fields
from bagpipe.spec import Images, JobFile, SimulationJobSpec
from bagpipe.storage import StorageError

_MOST_SLOTS = 64
_ENDED_BEFORE = "the run in this folder has ended: nothing is run again, and its verdict is shown"


@dataclass(frozen=True)
class Wanted:
    """What the command line says beside the manifest."""

    volumes: tuple[str, ...]
    results: Path | None
    slots: int | None
    cases: tuple[str, ...]
    variants: tuple[str, ...]
    agent: str
    resume: bool
    replace: bool
    spark: bool
    output: str


@click.command("run")
@click.argument("manifest", type=click.Path(path_type=Path))
@volume_option
@click.option(
    "--results",
    type=click.Path(path_type=Path, file_okay=False),
    help="The folder of the results.  [default: ./bagpipe-results/JOB]",
)
@click.option(
    "--slots",
    type=click.IntRange(1, _MOST_SLOTS),
    help="How many cases run at once.  [default: as the job says, at most one per processor]",
)
@click.option(
    "--cases",
    multiple=True,
    metavar="NUMBER|NAME",
    help="Only so many cases, or those whose names match, such as 'night-*'. May be repeated.",
)
@click.option(
    "--variant",
    "variants",
    multiple=True,
    metavar="NAME",
    help="Only this variant. May be repeated.",
)
@click.option(
    "--agent", default="bagpipe-agent", show_default=True, help="The program bagpipe-agent."
)
@click.option("--resume", is_flag=True, help="Go on with an interrupted run of this folder.")
@click.option("--replace", is_flag=True, help="Remove the folder's earlier run first.")
@click.option("--spark", is_flag=True, help="Run the cases on a local Spark, as a cluster does.")
@output_option
def run_command(manifest: Path, **given: Any) -> None:
    """Run the SimulationJob in MANIFEST on this machine, without Kubernetes.

    The agent, the stack and a process for each slot run on this machine, with the same planner,
    player, judge and results as on a cluster; with --spark a local Spark is in the slots' place,
    for which there must be Java and PySpark. Images are not used: this machine must have what the
    stack's image has, the command, and for ROS 2 that it is sourced. Run it inside of that image,
    or where the stack is built. Where the job is goes to stderr; Ctrl-C ends all that was started.

    The exit status is 0 if the verdict is Passed, 1 if it is another, and 2 if there is none.

    \b
    bagpipe run job.yaml --volume recordings=/data/recordings
    bagpipe run job.yaml --cases 3 --slots 1 --replace
    bagpipe run job.yaml --cases 'night-0004*' --variant pr-812 --output json
    """
    wanted = Wanted(**given)
    try:
        found = _run(manifest, wanted)
    except (ManifestError, MatrixError, StorageError, ReplayError, RunError) as error:
        raise RefusedError(str(error)) from error
    except KeyboardInterrupt:
        raise RefusedError("interrupted before a case ran") from None
    print_results(found, wanted.output)
    raise SystemExit(status_of(found))


def _run(manifest: Path, wanted: Wanted) -> dict[str, Any]:
    name, whole = read_job(manifest)
    spec = of_variants(whole, wanted.variants)
    if wanted.cases:
        spec = without_missing(spec)
    return run_spec(name, spec, read_marks(manifest), wanted)


def run_spec(
    name: str,
    spec: SimulationJobSpec,
    marks: dict[str, dict[str, str]],
    wanted: Wanted,
    seconds: float = math.inf,
) -> dict[str, Any]:
    """Run a job as `wanted` says, and describe its results as `bagpipe results` does.

    It is ended after `seconds`. Raises StorageError, MatrixError, ReplayError, and RunError with
    what this machine lacks or what ended the run.
    """
    volumes = folders(wanted.volumes)
    folder = wanted.results or Path("bagpipe-results", name)
    agent = _checked(spec, volumes, wanted)
    begun = beginning(spec, volumes, wanted.cases)
    console = QuietConsole(stderr=True, emoji=False)
    slots = wanted.slots or _slots(spec)
    with run_folder(folder, begun, resume=wanted.resume, replace=wanted.replace) as has_ended:
        reported = [_ENDED_BEFORE] if has_ended else list(notes(spec, folder))
        spec, baseline = without_schedule(spec)
        for note in [*reported, *([baseline.message] if baseline else [])]:
            console.print(f"[dim]note:[/] {escape(note)}", highlight=False, soft_wrap=True)
        job = JobFile(
            name=name,
            namespace="local",
            uid=str(uuid.uuid4()),
            attempt=1,
            spec=spec,
            images=Images(spark="none", agent="none"),
            volumes=volumes,
            results=file_uri(folder),
            baseline=baseline,
            labels=marks["labels"],
            annotations=marks["annotations"],
        )
        with Showing(console, slots, wanted.spark) as showing:
            driver = Driver(slots, wanted.cases, wanted.spark)
            progress = run_here(job, agent, driver, folder, showing.show, seconds)
    if not (folder / "manifest.json").exists():
        message = f"{progress['reason']}: {progress['message']}"
        raise RunError(f"{message} ({folder / 'driver.log'} has details)")
    console.print(escape(f"{folder} has report.html, results.jsonl and more"), soft_wrap=True)
    results = results_at(str(folder), {})
    return {"results": str(folder.resolve())} | describe(results, failed=False)


def _checked(spec: SimulationJobSpec, volumes: dict[str, str], wanted: Wanted) -> str:
    """The agent's program; raises RunError with all that this machine lacks."""
    machine = Machine(own_environment())
    lacking = list(refusals(spec, volumes, machine))
    program = agent_program(wanted.agent)
    if program is None:
        lacking.append(f"there is no {wanted.agent} on this machine: give --agent")
    lacking += _spark_lacks() if wanted.spark else []
    # The driver would miss it only when cases are planned.
    if spec.source.uris and source_fields(spec.source.kind).bags:
        try:
            native("TailError", "reading a bag")
        except NativeModuleError as error:
            lacking.append(str(error))
    if lacking or program is None:
        raise RunError("\n".join(lacking))
    return program


def _spark_lacks() -> list[str]:
    lacking = []
    java = os.environ.get("JAVA_HOME")
    if shutil.which("java", path=f"{java}/bin" if java else None) is None:
        lacking.append(
            "Spark needs Java 17 or newer: install a JRE, or set JAVA_HOME; or leave --spark out"
        )
    if importlib.util.find_spec("pyspark") is None:
        lacking.append(
            "PySpark is not installed: leave --spark out, or install bagpipe with its extra spark,"
            " as in pip install './images/spark[cli,spark,storage]'"
        )
    return lacking


def _slots(spec: SimulationJobSpec) -> int:
    return min(spec.spark.most_slots, len(os.sched_getaffinity(0)), _MOST_SLOTS)
