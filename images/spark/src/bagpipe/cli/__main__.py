"""`bagpipe` and `python -m bagpipe.cli`."""

import click

from bagpipe.cli.bag import bag_group
from bagpipe.cli.compare import compare_command
from bagpipe.cli.completion import completion_command
from bagpipe.cli.last_words import LastWords
from bagpipe.cli.logs import logs_command
from bagpipe.cli.plan import plan_command
from bagpipe.cli.replay import replay_command
from bagpipe.cli.report import report_command
from bagpipe.cli.results import results_command
from bagpipe.cli.run import run_command
from bagpipe.cli.submit import submit_command
from bagpipe.cli.watch import watch_command


@click.group(
    cls=LastWords,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="bagpipe")
def main() -> None:
    """Replays recorded drives through the software under test, and says whether it still works.

    The exit status is 0 for what passed, 1 for what failed or got worse, and 2 for what could not
    be read or run.
    """


for command in (
    plan_command, run_command, submit_command, watch_command, logs_command, results_command,
    compare_command, report_command, replay_command, bag_group, completion_command,
):  # fmt: skip
    main.add_command(command)

if __name__ == "__main__":
    main()
