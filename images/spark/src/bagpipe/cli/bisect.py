"""`bagpipe bisect`: the first bad commit, as a step of `git bisect run`, or the first bad image."""

import contextlib
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.markup import escape

from bagpipe.cli.bisect_images import Images, search
from bagpipe.cli.cluster.place import Place, place_options
from bagpipe.cli.cluster.watching import Seconds
from bagpipe.cli.judged_step import Step, is_decided, of_round, of_rounds
from bagpipe.cli.manifest import ManifestError, read_job, read_marks
from bagpipe.cli.places import RefusedError, output_option, volume_option
from bagpipe.cli.run import Wanted, run_spec
from bagpipe.cli.running import RunError, RunInterruptedError
from bagpipe.cli.terminal import plain
from bagpipe.matrix.faults import MatrixError
from bagpipe.run.laptop import ReplayError
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import StorageError

# As `git bisect run` reads them: from 128 on it stops, and every other number but 0 and 125 is bad.
_STATUS = {"good": 0, "bad": 1, "unknown": 125}
_INTERRUPTED = 130
_USAGE = 129
_COLOURS = {"good": "green", "bad": "red", "unknown": "yellow"}
_GIT_SECONDS = 30


class _Step(click.Command):
    """A command whose mistakes in the command line stop `git bisect run`: 2 would be bad."""

    def make_context(
        self,
        info_name: str | None,
        args: list[str],
        parent: click.Context | None = None,
        **extra: object,
    ) -> click.Context:
        """The context; a fault of usage has a status of its own."""
        try:
            return super().make_context(info_name, args, parent, **extra)
        except click.UsageError as error:
            with _whoever_reads():
                error.show()
            raise SystemExit(_USAGE) from error


@dataclass(frozen=True)
class _Asked:
    """What the command line says beside the manifest."""

    cases: tuple[str, ...]
    rounds: int
    timeout: float
    results: Path | None
    volumes: tuple[str, ...]
    slots: int | None
    agent: str
    good: str | None
    bad: str | None
    images: Path | None
    place: Place
    output: str

    def of_images(self) -> Images:
        """A search of images; ends the program where a part of it is missing."""
        if not (self.good and self.bad and self.images):
            with _whoever_reads():
                click.UsageError("--good, --bad and --images go together: write all three").show()
            raise SystemExit(_USAGE)
        return Images(
            self.good, self.bad, self.images, self.cases, self.rounds, self.timeout, self.volumes,
            self.place, self.output,
        )  # fmt: skip

    def of_a_run(self) -> Wanted:
        """A run on this machine."""
        # A driver takes a number for so many cases, and no pattern for one.
        names = (f"[{name[0]}]{name[1:]}" if name.isdecimal() else name for name in self.cases)
        return Wanted(
            volumes=self.volumes, results=self.results, slots=self.slots, cases=tuple(names),
            variants=(), agent=self.agent, resume=False, replace=True, spark=False, output="table",
        )  # fmt: skip


@click.command("bisect", cls=_Step)
@click.argument("manifest", type=click.Path(path_type=Path))
@click.option(
    "--case",
    "cases",
    multiple=True,
    required=True,
    metavar="NAME",
    help="The case, or those whose names match, such as 'night-*'. May be repeated.",
)
@click.option(
    "--rounds",
    type=click.IntRange(1, 100),
    default=1,
    show_default=True,
    help="Run them so often. Rounds that disagree are 125.",
)
@click.option(
    "--timeout",
    type=Seconds(),
    default="1h",
    show_default=True,
    help="How long a round may take. One that takes longer is 125.",
)
@click.option(
    "--results",
    type=click.Path(path_type=Path, file_okay=False),
    help="The folder of all steps' results.  [default: ./bagpipe-results/JOB-bisect]",
)
@volume_option
@click.option("--slots", type=click.IntRange(1, 64), help="As of bagpipe run.")
@click.option(
    "--agent", default="bagpipe-agent", show_default=True, help="The program bagpipe-agent."
)
@click.option("--good", metavar="IMAGE", help="The image that is good; with --bad and --images.")
@click.option("--bad", metavar="IMAGE", help="The image that is bad.")
@click.option(
    "--images",
    type=click.Path(path_type=Path, dir_okay=False, allow_dash=True),
    help="A file with the images between them, one in a line, the oldest first; - is stdin.",
)
@place_options
@output_option
def bisect_command(manifest: Path, **given: Any) -> None:
    """Find the commit, or the image, that broke cases of the SimulationJob in MANIFEST.

    Without images it is one step of `git bisect run`, of what is checked out. The cases are run as
    `bagpipe run` does, in a folder of results for each commit and round. The job's verdict is not
    asked, and so neither its baseline nor its quarantine: only the cases' outcomes.

    The exit status is 0 if all passed, 1 if one failed, and 125, by which git passes a commit over,
    if nothing was shown: a case is invalid or errored, rounds disagree, the job is refused here or
    took too long. It is 129 for a mistake in the command line and 130 after Ctrl-C, by which git
    stops. Those of bagpipe run are not for git, which takes 2 for a bad commit. Build before it,
    and end with 125 where that fails.

    With --good, --bad and --images a job with all its cases runs in the cluster for each image that
    is looked at, under a name of its own, and is deleted when its results are read; --volume says
    where a claim's are. Both ends come first. The exit status is 0 if one image is the first bad
    one, 1 if it is one of several since some can't be judged, and 2 if an end is not what it was
    called, or the cluster refuses the job.

    \b
    git bisect start BAD GOOD
    git bisect run bagpipe bisect job.yaml --case night-0004 --rounds 3
    git bisect run sh -c 'make || exit 125; bagpipe bisect job.yaml --case night-0004'
    bagpipe bisect job.yaml --case night-0004 --good lane:1.4 --bad lane:1.5 --images tags.txt
    """
    asked = _Asked(**given)
    if asked.good or asked.bad or asked.images:
        raise SystemExit(search(manifest, asked.of_images()))
    console = Console(stderr=True, emoji=False)
    try:
        step = _judged(manifest, asked.of_a_run(), asked.rounds, asked.timeout)
    except (RunInterruptedError, KeyboardInterrupt) as error:
        with _whoever_reads():
            click.echo(plain(f"interrupted: {error}" if str(error) else "interrupted"), err=True)
        raise SystemExit(_INTERRUPTED) from None
    # Whatever it is, it shows nothing of the commit; rich exits with 1 where nobody reads stderr.
    except (Exception, SystemExit) as error:  # noqa: BLE001
        known = isinstance(error, (ManifestError, MatrixError, RefusedError, StorageError))
        text = str(error) if known else f"{type(error).__name__}: {error}"
        step = Step("unknown", f"could not be run: {text}")
    colour = _COLOURS[step.word]
    why = escape(plain(step.why))
    with _whoever_reads():
        console.print(
            f"[bold {colour}]{step.word}[/]  {_commit()}: {why}", highlight=False, soft_wrap=True
        )
    raise SystemExit(_STATUS[step.word])


@contextlib.contextmanager
def _whoever_reads() -> Iterator[None]:
    """What can't be written, to a pipe that is closed or a full disk, changes no status: click and
    rich end with 1 then, which is bad to git.
    """
    with contextlib.suppress(OSError, SystemExit):
        yield


def _judged(manifest: Path, wanted: Wanted, rounds: int, seconds: float) -> Step:
    name, whole = read_job(manifest)
    marks = read_marks(manifest)
    folder = (wanted.results or Path("bagpipe-results", f"{name}-bisect")) / _commit()
    found: list[Step] = []
    for number in range(rounds):
        of_it = Wanted(**(vars(wanted) | {"results": folder / f"round-{number}"}))
        found.append(_round(name, _alone(whole), marks, of_it, seconds))
        if is_decided(found):
            break
    return of_rounds(found)


def _round(
    name: str,
    spec: SimulationJobSpec,
    marks: dict[str, dict[str, str]],
    wanted: Wanted,
    seconds: float,
) -> Step:
    try:
        found = run_spec(name, spec, marks, wanted, seconds)
    except RunInterruptedError:
        raise
    except (RunError, ReplayError) as error:
        return Step("unknown", str(error))
    return of_round(found["cases"], found["counts"]["planned"], wanted.cases)


def _alone(spec: SimulationJobSpec) -> SimulationJobSpec:
    """The job without what speaks of other jobs, and of cases that are not to be looked at."""
    return spec.model_copy(update={"baseline": None, "quarantine": [], "max_failed_cases": None})


def _commit() -> str:
    """What is checked out here, in short; `here` outside of a repository."""
    command = ["git", "rev-parse", "--short=12", "HEAD"]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_GIT_SECONDS, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return "here"
    word = done.stdout.strip()
    return word if done.returncode == 0 and word.isalnum() else "here"
