"""A verb whose module is imported when it is needed: Tab and --help wait for no numpy."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

import click

_HELP = frozenset({"-h", "--help"})


class Verb(click.Command):
    """Stands for a command of another module until it runs or its own help is shown."""

    def __init__(
        self, name: str, command: str, short_help: str, before: Callable[[], None] | None = None
    ) -> None:
        """`command` is the name of a click command in `bagpipe.cli.<name>`.

        `before` is called before that is imported, unless help is asked for.
        """
        super().__init__(name, short_help=short_help)
        self._command, self._before = command, before

    def load(self) -> click.Command:
        """The command itself."""
        module = import_module(f"bagpipe.cli.{self.name}")
        command: click.Command = getattr(module, self._command)
        return command

    def make_context(
        self,
        info_name: str | None,
        args: list[str],
        parent: click.Context | None = None,
        **extra: Any,
    ) -> click.Context:
        """The command's own: click goes on with the command that is in the context."""
        completes = bool(extra.get("resilient_parsing"))
        if self._before and args and not completes and not _HELP.intersection(args):
            self._before()
        return self.load().make_context(info_name, args, parent, **extra)
