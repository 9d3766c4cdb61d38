"""`bagpipe completion`: what a shell needs to complete the program's words and the jobs' names."""

import click
from click.shell_completion import get_completion_class

from bagpipe.cli.places import RefusedError

_PROGRAM = "bagpipe"


@click.command("completion")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion_command(shell: str) -> None:
    """Print a script that makes a shell complete verbs, options and the names of jobs.

    Names are asked of the cluster, for two seconds at most. bash must be 4.4 or later. For `kubectl
    bagpipe`, kubectl's own completion is enough: it asks kubectl_complete-bagpipe, which is
    installed beside this program.

    \b
    source <(bagpipe completion bash)              in ~/.bashrc
    source <(bagpipe completion zsh)               in ~/.zshrc, after compinit
    bagpipe completion fish > ~/.config/fish/completions/bagpipe.fish
    """
    kind = get_completion_class(shell)
    if kind is None:
        raise RefusedError(f"click knows no completion for {shell}")
    root = click.get_current_context().find_root().command
    script = kind(root, {}, _PROGRAM, f"_{_PROGRAM.upper()}_COMPLETE")
    # Its source() would ask the bash on PATH for its version, which may not be the one that reads.
    click.echo(script.source_template % script.source_vars(), nl=False)
