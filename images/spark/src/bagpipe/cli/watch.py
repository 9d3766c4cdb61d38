"""`bagpipe watch`: how far a job in the cluster is, until it has ended."""

import click
from rich.console import Console

from bagpipe.cli.cluster.place import Place, job_names, place_options
from bagpipe.cli.cluster.watching import followed, show_end, timeout_option
from bagpipe.cli.places import output_option, print_as


@click.command("watch")
@click.argument("name", metavar="JOB", shell_complete=job_names)
@place_options
@timeout_option
@output_option
def watch_command(name: str, place: Place, timeout: float, output: str) -> None:
    """Follow a job in the cluster to its end.

    A terminal shows one block that is redrawn: counts, cases per minute, the time that is left
    at this rate, and what a stuck job waits for. Otherwise a line is written for each change. With
    --output json or yaml the lines go to stderr, and stdout gets the job's last state.

    The exit status is 0 if the verdict is Passed, 1 if it is Failed or Invalid, and 2 if the job
    could not be run or has not ended within --timeout.

    \b
    bagpipe watch nightly
    bagpipe watch nightly -n robots --timeout 30m
    """
    console = Console(stderr=output != "table", emoji=False)
    state = followed(place.cluster(), name.removeprefix("job/"), timeout, console)
    if output == "table":
        show_end(state, console)
    else:
        print_as(state.as_json(), output)
    raise SystemExit(state.exit_status)
