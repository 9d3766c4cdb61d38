"""Where commands find things: folders that stand for claims, and results by URI or folder."""

import json
from pathlib import Path
from typing import Any

import click
import yaml

from bagpipe.cli.terminal import plain
from bagpipe.report.stored import StoredResults
from bagpipe.storage import Storage, StorageError


class RefusedError(click.ClickException):
    """What was asked for can't be read or run: the sentence goes to stderr, the status is 2."""

    exit_code = 2

    def format_message(self) -> str:
        """The sentence, or one in each line, without what a terminal would obey: names of files and
        words of a stack may be in it.
        """
        return "\n".join(map(plain, self.message.split("\n")))


volume_option = click.option(
    "--volume",
    "volumes",
    multiple=True,
    metavar="CLAIM=FOLDER",
    help="A folder on this machine that stands for a PersistentVolumeClaim. May be repeated.",
)

output_option = click.option(
    "--output",
    type=click.Choice(["table", "json", "yaml"]),
    default="table",
    show_default=True,
    help="How it is written.",
)


def folders(volumes: tuple[str, ...]) -> dict[str, str]:
    """The folders that stand for claims, by claim. Raises StorageError with what to write."""
    found = {}
    for volume in volumes:
        claim, equals, folder = volume.partition("=")
        if not equals or not claim or not Path(folder).is_dir():
            raise StorageError(f"--volume {volume}: write the claim's name, =, and a folder")
        found[claim] = str(Path(folder).resolve())
    return found


def results_at(where: str, volumes: dict[str, str]) -> StoredResults:
    """The results at a URI as `status.results` has it, or in a folder of this machine.

    Raises StorageError where there is no such folder, or a claim has none.
    """
    if "://" not in where and not Path(where).is_dir():
        raise StorageError(
            f"there is no {file_uri(Path(where))}: no folder of this machine has that name. For a"
            f" job in the cluster write job/{Path(where).name}"
        )
    return StoredResults(uri_of(where, volumes), Storage(volumes))


def uri_of(where: str, volumes: dict[str, str]) -> str:
    """The URI of what was named by its URI, or by its path on this machine.

    Raises StorageError where a claim has no folder.
    """
    if "://" not in where:
        return file_uri(Path(where))
    claim = where.removeprefix("pvc://").split("/", 1)[0]
    if where.startswith("pvc://") and claim not in volumes:
        raise StorageError(
            f"{where}: the claim {claim} is not on this machine: give --volume {claim}=FOLDER, or"
            " the folder's own path"
        )
    return where.rstrip("/")


def file_uri(path: Path) -> str:
    """The URI of a file or folder of this machine as storage reads it: its path as it is."""
    return f"file://{path.resolve()}"


def print_as(found: Any, output: str) -> None:
    """Writes data to stdout, as `output` says: json or yaml."""
    if output == "json":
        click.echo(json.dumps(found, indent=1))
    else:
        click.echo(yaml.safe_dump(found, sort_keys=False, allow_unicode=True), nl=False)


def status_of(manifest: dict[str, Any]) -> int:
    """0 for a job that passed, 1 for one that did not, 2 for one without a verdict."""
    return {"Passed": 0, "Failed": 1, "Invalid": 1}.get(str(manifest["verdict"]), 2)
