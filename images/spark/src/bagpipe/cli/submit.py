"""`bagpipe submit`: a job into the cluster, and the verdict for whoever waits."""

from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.markup import escape

from bagpipe.cli.cluster.hints import again
from bagpipe.cli.cluster.place import Place, place_options
from bagpipe.cli.cluster.state import JobState
from bagpipe.cli.cluster.watching import followed, show_end, timeout_option
from bagpipe.cli.manifest import ManifestError, read_object
from bagpipe.cli.places import RefusedError, output_option, print_as


@click.command("submit")
@click.argument("manifest", type=click.Path(path_type=Path, allow_dash=True))
@place_options
@click.option("--name", metavar="NAME", help="A name in place of the manifest's.")
@click.option(
    "--generate-name",
    is_flag=True,
    help="A new name for each run: the manifest's, a hyphen and five letters.",
)
@click.option("--dry-run", is_flag=True, help="Let the API server judge the job and not keep it.")
@click.option("--wait", is_flag=True, help="Follow the job to its end, as `bagpipe watch` does.")
@timeout_option
@output_option
def submit_command(
    manifest: Path,
    place: Place,
    name: str | None,
    generate_name: bool,
    dry_run: bool,
    wait: bool,
    timeout: float,
    output: str,
) -> None:  # fmt: skip
    """Create the SimulationJob in MANIFEST in the cluster; - reads it from stdin.

    The API server judges the manifest: each fault is a sentence that says what to write. Other
    objects of the file, such as claims, are left to kubectl.

    Without --wait the exit status is 0 when the job was created. With --wait it is 0 if the verdict
    is Passed, 1 if it is Failed or Invalid, and 2 if the job was refused, could not be run or has
    not ended within --timeout; a CI needs nothing else.

    \b
    bagpipe submit job.yaml
    bagpipe submit job.yaml -n robots --generate-name --wait --timeout 30m
    bagpipe submit job.yaml --dry-run --output yaml
    """
    if name and generate_name:
        raise RefusedError("--name and --generate-name both say how the job is called: leave one")
    if dry_run and wait:
        raise RefusedError("--dry-run creates no job that could be waited for: leave out --wait")
    job, others = _job(manifest)
    _call(job, name, generate_name)
    cluster = Place(place.context, _namespace(job, place.namespace)).cluster()
    made = cluster.create(job, dry_run)
    progress = Console(stderr=output != "table", emoji=False)
    if others:
        click.echo(
            f"{others} other objects of {manifest} were not created: kubectl apply -f {manifest}",
            err=True,
        )
    _show_created(made, dry_run, wait, progress)
    if not wait:
        if output != "table":
            print_as(made, output)
        return
    state = followed(cluster, made["metadata"]["name"], timeout, progress)
    _print_end(state, output, progress)


def _job(manifest: Path) -> tuple[dict[str, Any], int]:
    try:
        return read_object(manifest)
    except ManifestError as error:
        raise RefusedError(str(error)) from error


def _namespace(job: dict[str, Any], asked: str | None) -> str | None:
    written = job["metadata"].get("namespace")
    if asked and written and asked != written:
        raise RefusedError(
            f"the manifest says namespace {written} and -n says {asked}: make them one, or leave"
            " the namespace out of the manifest"
        )
    return asked or written


def _call(job: dict[str, Any], name: str | None, generate: bool) -> None:
    """Writes the name that was asked for into the manifest."""
    metadata = job["metadata"]
    if generate and metadata.get("name"):
        metadata["generateName"] = f"{metadata.pop('name')}-"
    elif name:
        metadata.pop("generateName", None)
        metadata["name"] = name
    if not metadata.get("name") and not metadata.get("generateName"):
        raise RefusedError("metadata.name is missing: write it, or give --name")


def _show_created(made: dict[str, Any], dry_run: bool, wait: bool, console: Console) -> None:
    name, namespace = made["metadata"]["name"], made["metadata"]["namespace"]
    if dry_run:
        text = f"job {name} would be created in namespace {namespace}; nothing is kept (dry run)"
        console.print(text, highlight=False, soft_wrap=True)
        return
    console.print(
        f"job {name} is created in namespace {namespace}", highlight=False, soft_wrap=True
    )
    if not wait:
        for verb in (f"watch {name}", f"logs {name}", f"results job/{name}"):
            hint = escape(again(verb, namespace))
            console.print(f"  {hint}", highlight=False, soft_wrap=True)


def _print_end(state: JobState, output: str, console: Console) -> None:
    if output == "table":
        show_end(state, console)
    else:
        print_as(state.as_json(), output)
    raise SystemExit(state.exit_status)
