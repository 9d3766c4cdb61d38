"""How the program ends on an error that no verb handles."""

import os
import sys
import traceback
from typing import Any

import click

from bagpipe.cli.terminal import plain
from bagpipe.native import NativeModuleError

# A shell's status of a program that Ctrl-C ended.
_INTERRUPTED = 130
_NOT_RUN = 2
_TRACEBACK = "BAGPIPE_TRACEBACK"


class UnhandledErrors(click.Group):
    """A program that never ends with 1, a verdict that failed, because of a fault or of Ctrl-C."""

    def invoke(self, ctx: click.Context) -> Any:
        """The verb, with a sentence and a status of its own for all that it does not catch."""
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.Abort, click.exceptions.Exit, BrokenPipeError):
            raise  # click's own, and what it ends quietly
        except KeyboardInterrupt:
            click.echo("\ninterrupted" if sys.stderr.isatty() else "interrupted", err=True)
            raise SystemExit(_INTERRUPTED) from None
        except Exception as error:  # whatever it is
            wanted = bool(os.environ.get(_TRACEBACK))
            if wanted:
                for line in traceback.format_exc().splitlines():
                    click.echo(plain(line), err=True)
            where = "" if wanted else f"; {_TRACEBACK}=1 shows where"
            text = f"{type(error).__name__}: {error}".removesuffix(": ")
            # Its words may be those of a file that somebody else has written.
            fault = plain(f"unexpected fault, please report it: {text}{where}")
            known = _is_of_what_is_installed(error) or isinstance(error, NativeModuleError)
            click.echo(f"Error: {error if known else fault}", err=True)
            raise SystemExit(_NOT_RUN) from error


def _is_of_what_is_installed(error: Exception) -> bool:
    """Whether it is the InstallationError of any verb that reads a spec."""
    # Not imported: it is there if it was raised, and else the import may fail as the verb's did.
    installed = sys.modules.get("bagpipe.installed")
    return installed is not None and isinstance(error, installed.InstallationError)
