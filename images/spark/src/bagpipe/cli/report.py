"""`bagpipe report`: the page of a job's results, made again."""

from pathlib import Path

import click

from bagpipe.cli.cluster.place import Place, place_options, results_places
from bagpipe.cli.cluster.results_of import results_of
from bagpipe.cli.places import (
    RefusedError,
    file_uri,
    folders,
    output_option,
    print_as,
    volume_option,
)
from bagpipe.cli.terminal import plain
from bagpipe.report.html import Report
from bagpipe.report.stored import StoredResults
from bagpipe.storage import StorageError


@click.command("report")
@click.argument("where", metavar="RESULTS", shell_complete=results_places)
@place_options
@volume_option
@output_option
@click.option(
    "-o",
    "--to",
    "page",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("report.html"),
    show_default=True,
    help="Where the page is written.",
)
def report_command(
    where: str, place: Place, volumes: tuple[str, ...], output: str, page: Path
) -> None:
    """Make one self-contained HTML page of a job's results.

    RESULTS is job/NAME for a job in the cluster (NAME alone after -n), the URI in the job's
    status.results, or a folder of this machine. Every job leaves such a page as report.html
    already; this makes it again, for example with a newer version. With --output json or yaml
    stdout gets the page's uri and its length in bytes; the page is HTML always.

    \b
    bagpipe report job/nightly -n robots
    bagpipe report s3://results/lane/nightly/0c1f... -o nightly.html
    """
    try:
        stored = results_of(place, where, folders(volumes))
        manifest, comparisons = stored.manifest(), stored.comparisons()
        spec = stored.spec()
        report = Report(spec, stored.uri, comparisons)
        for row in stored.rows():
            report.add(row)
        if spec is not None and spec.compared_with is not None:
            _lay_over(report, StoredResults(spec.compared_with, stored.storage))
        made = report.html(manifest, comparisons)
        page.write_bytes(made)
    except StorageError as error:
        raise RefusedError(str(error)) from error
    except OSError as error:
        raise RefusedError(f"{page} can't be written: {error.strerror}") from error
    if output == "table":
        click.echo(f"{page}: {len(made):,} bytes")
    else:
        print_as({"uri": file_uri(page), "bytes": len(made)}, output)


def _lay_over(report: Report, baseline: StoredResults) -> None:
    try:
        report.add_earlier(baseline.baseline_rows())
    except StorageError as error:
        click.echo(f"note: the page has no course of the baseline: {plain(str(error))}", err=True)
