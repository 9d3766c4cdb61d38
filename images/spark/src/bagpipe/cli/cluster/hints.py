"""Command lines that can be copied from a message: of the same program, about the same cluster."""

import shlex

import click


def program() -> str:
    """What the user typed to get here: `bagpipe` or `kubectl bagpipe`."""
    context = click.get_current_context(silent=True)
    return (context.find_root().info_name if context else None) or "bagpipe"


def again(words: str, namespace: str | None = None, *more: str) -> str:
    """The program once more; where no namespace is known, in the one that was asked for."""
    namespace = namespace or _given("namespace")
    place = f" -n {shlex.quote(namespace)}" if namespace else ""
    return " ".join([f"{program()} {words}{place}{in_context()}", *more])


def in_context() -> str:
    """` --context NAME` where one was asked for, for kubectl as well."""
    context = _given("context")
    return f" --context {shlex.quote(context)}" if context else ""


def _given(name: str) -> str | None:
    """The value of an option of the verb that runs."""
    context = click.get_current_context(silent=True)
    return context.params.get(name) if context else None
