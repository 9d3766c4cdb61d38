"""`bagpipe init`: a job for recordings, from what they show."""

import shlex
from pathlib import Path
from typing import Any

import click
import yaml
from pydantic import ValidationError

from bagpipe.cli.first_job.facts import Recordings
from bagpipe.cli.first_job.looking import Looking
from bagpipe.cli.first_job.places import Placed, placed
from bagpipe.cli.first_job.proposing import Asked, Proposal, ProposalError, fragment_length, propose
from bagpipe.cli.first_job.stack_image import ImageError, look_at
from bagpipe.cli.first_job.writing import Written, manifest, printable
from bagpipe.cli.places import RefusedError, folders, volume_option
from bagpipe.native import NativeModuleError, native
from bagpipe.source.bags.expanding import recordings as named_by
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Patience, Storage, StorageError

# What a job names (spec.source.bags).
_MOST_BAGS = 1000
_LONGEST_SENTENCE = 600
# Somebody waits at a terminal.
_PATIENCE = Patience(request_seconds=15.0, tries=3)


@click.command("init")
@click.argument("recordings", nargs=-1, required=True)
@volume_option
@click.option(
    "--input",
    "inputs",
    multiple=True,
    metavar="TOPIC",
    help="A topic that the stack subscribes to. May be repeated.  [default: all are played]",
)
@click.option(
    "--output",
    "outputs",
    multiple=True,
    metavar="TOPIC",
    help="A topic that the stack publishes: it is recorded, and judged by what the recordings show"
    " of it. May be repeated.",
)
@click.option(
    "--image",
    default="",
    metavar="IMAGE",
    help="The stack's image: its name, or an archive or a folder of it (OCI, docker save).",
)
@click.option("--command", default="", metavar="WORDS", help="What starts the stack's nodes.")
@click.option(
    "--mode",
    type=click.Choice(["realtime", "lockstep"]),
    default="realtime",
    show_default=True,
    help="The pace of the playback. In lockstep no verdict depends on how busy the machine is.",
)
@click.option(
    "--step",
    "steps",
    multiple=True,
    metavar="TRIGGER=ANSWER",
    help="In lockstep, the recorded topic after whose messages the stack's answer is awaited. May"
    " be repeated.  [default: until no node has work, which ROS 1 can't show]",
)
@click.option("--name", default="", metavar="NAME", help="The job's name.")
@click.option(
    "-o",
    "target",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Where the manifest is written; a file that is there stays.  [default: stdout]",
)
def init_command(recordings: tuple[str, ...], **given: Any) -> None:
    """Write a SimulationJob for RECORDINGS, with comments on what they show and what you must say.

    A recording is a bag, a file of MCAP, a folder of rosbag2, a folder of these, or a URI, which
    may have wildcards. Indexes and a few chunks are read, of the first 20 recordings, for about
    half a minute at most. A file becomes one of the claim `recordings`, for which its folder stands
    here; --volume names another.

    Which topics the stack answers on is not in a recording: name them by --output. With --image
    this program looks at an archive of the image, or asks docker or podman about it.

    \b
    bagpipe init drive.bag
    bagpipe init drives/ --output /odometry/filtered -o job.yaml
    bagpipe init 's3://fleet/2026-11/*.mcap' --image registry.example/lane:1.4
    """
    try:
        proposal, found, places, image = _proposed(recordings, **given)
        how = _how(places, given["target"])
        text = manifest(proposal, found, Written(how, image))
        _check(text)
        _write(text, given["target"])
    except (StorageError, ProposalError, ImageError, NativeModuleError) as error:
        lines = [printable(line, _LONGEST_SENTENCE) for line in str(error).split("\n")]
        raise RefusedError("\n".join(lines)) from error
    if given["target"] is not None:
        for line in [f"{given['target']} is written", *how]:
            click.echo(line)
    for sentence in found.refused:
        click.echo(f"can't be played: {printable(sentence, _LONGEST_SENTENCE)}", err=True)


def _proposed(
    recordings: tuple[str, ...], volumes: tuple[str, ...], image: str, **given: Any
) -> tuple[Proposal, Recordings, Placed, list[str]]:
    native("TailError", "reading a recording")
    places = placed(recordings, folders(volumes))
    if len(places.bags) > _MOST_BAGS:
        raise ProposalError(
            f"{len(places.bags)} recordings are named, and a job names at most {_MOST_BAGS}: write"
            " a pattern in quotes, such as 'drives/*.bag', or their folder"
        )
    storage = Storage(places.volumes, _PATIENCE)
    uris, missing = named_by(places.bags, storage)
    found = Looking(storage, given["outputs"]).into(uris, fragment_length)
    found.refused.extend(bag.message for bag in missing)
    if not found.looked:
        raise ProposalError("\n".join(found.refused) or "no recording is there")
    looked_at = look_at(image) if image else None
    asked = _asked(places, looked_at.name if looked_at else "", given)
    proposal = propose(asked, found)
    return proposal, found, places, looked_at.sentences(proposal.engine) if looked_at else []


def _asked(places: Placed, image: str, given: dict[str, Any]) -> Asked:
    return Asked(
        given["name"] or places.name,
        places.bags,
        given["inputs"],
        given["outputs"],
        image,
        tuple(_words(given["command"])),
        given["mode"],
        tuple(map(_step, given["steps"])),
    )


def _words(command: str) -> list[str]:
    try:
        return shlex.split(command)
    except ValueError as error:
        raise ProposalError(f"--command {command!r}: {error}: close the quotes") from error


def _step(text: str) -> tuple[str, str]:
    trigger, equals, answer = text.partition("=")
    if not equals:
        raise ProposalError(f"--step {text!a}: write TRIGGER=ANSWER, such as /camera/image=/lane")
    return trigger, answer


def _how(places: Placed, target: Path | None) -> list[str]:
    """How to go on; the words are of the user's own shell."""
    job = shlex.quote(str(target or "job.yaml"))
    lines = [f"bagpipe plan {job}{places.options}", f"bagpipe run {job}{places.options}"]
    lines.append(f"bagpipe submit {job} --wait")
    if places.volumes:
        claims = " and ".join([*sorted(places.volumes), "results"])
        lines[-1] += f"    # in a cluster, whose claims {claims} have them"
    return [printable(line) for line in lines]


def _check(text: str) -> None:
    """No manifest is written that `bagpipe plan` refuses. Raises ProposalError."""
    try:
        SimulationJobSpec.model_validate(yaml.safe_load(text)["spec"])
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(["spec", *map(str, first["loc"])])
        sentence = f"{where}: {first['msg'].removeprefix('Value error, ')}"
        if "playback.steps are missing" in sentence:
            sentence += " (by --step TRIGGER=ANSWER)"
        raise ProposalError(sentence) from error


def _write(text: str, target: Path | None) -> None:
    if target is None:
        click.echo(text, nl=False)
        return
    made = False
    try:
        with target.open("x") as file:
            made = True
            file.write(text)
    except FileExistsError as error:
        raise ProposalError(
            f"{target} is there already: choose another -o, or remove it"
        ) from error
    except OSError as error:
        if made:  # a part of it would keep the next call from writing it whole
            target.unlink(missing_ok=True)
        raise ProposalError(f"{target} can't be written: {error.strerror}") from error
