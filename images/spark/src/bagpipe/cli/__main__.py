"""`bagpipe` and `python -m bagpipe.cli`."""

import click

from bagpipe.cli.unhandled import UnhandledErrors
from bagpipe.cli.verb import Verb


@click.group(
    cls=UnhandledErrors,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="bagpipe")
def main() -> None:
    """Replays recorded drives through the software under test, and says whether it still works.

    The exit status is 0 for what passed, 1 for what failed or got worse, and 2 for what could not
    be read or run.
    """


def _begin_driver() -> None:
    from bagpipe.cli.driver_process import begin  # noqa: PLC0415  no other verb needs it

    begin()


_BEFORE = {"run": _begin_driver}

# Each by its command in the module of its name, and in so few words that a list cuts none.
for name, command, short_help in (
    ("init", "init_command", "Write a job for recordings."),
    ("doctor", "doctor_command", "Show what is missing for jobs."),
    ("plan", "plan_command", "Show the cases that a job would run."),
    ("run", "run_command", "Run a job on this machine, without a cluster."),
    ("submit", "submit_command", "Create a job in the cluster."),
    ("watch", "watch_command", "Follow a job in the cluster to its end."),
    ("logs", "logs_command", "Show what was written in a case of a job."),
    ("results", "results_command", "Show the verdict of a job, and its cases."),
    ("pull", "pull_command", "Copy a job's results to this machine."),
    ("list", "list_command", "List the results below a folder."),
    ("delete", "delete_command", "Remove the results of a job."),
    ("compare", "compare_command", "Compare two jobs' results, case by case."),
    ("report", "report_command", "Make the HTML page of a job's results."),
    ("replay", "replay_command", "Run a case of a job again on this machine."),
    ("bisect", "bisect_command", "Judge a commit by cases, for git bisect run."),
    ("history", "history_command", "Show what got worse over many runs."),
    ("open", "open_command", "Put a case into a file that viewers show."),
    ("bag", "bag_group", "Look into ROS 1 bags, cut, join, check them."),
    ("completion", "completion_command", "Print a script that completes words."),
):
    main.add_command(Verb(name, command, short_help, _BEFORE.get(name)))

if __name__ == "__main__":
    main()
