"""Whether an agent died because the stack in its container took too much memory. Pure."""

from bagpipe.wire.session import AgentGoneError, SessionError

REASON = "StackOutOfMemory"
# Of a case that passed behind one such try.
ONCE = "OutOfMemoryOnce"
_ADVICE = "raise spec.stack.resources.limits.memory"


def named(error: SessionError, kills: int, slots: int | None) -> SessionError:
    """The same error, or the one that it is where meanwhile so many processes of the node were
    ended for lack of memory.

    The kernel ends all of a container at once (`memory.oom.group`). Where it runs one case alone,
    its stack is the one that took the memory; where it runs several, it is not known which of them.
    Where it ends single processes, the agent's was the largest. The count is of the node: what of
    it was another pod's is not known.
    """
    if kills == 0 or slots is None or not isinstance(error, AgentGoneError):
        return error
    number = "a process" if kills == 1 else f"{kills} processes"
    seen = f"meanwhile the kernel of its node ended {number} for lack of memory"
    if kills > 1 and slots == 1:
        return SessionError(
            REASON,
            f"the stack's container ended, and {seen}: {_ADVICE}, or look at what the stack keeps",
            error.stderr,
        )
    whose = "the agent's own, or one of another pod"
    if kills > 1:
        whose = f"spark.slots ({slots}) cases share the container, so it is not known whose"
    return SessionError(error.reason, f"{error}; {seen}, {whose}: {_ADVICE}", error.stderr)


def passed_after(message: str) -> str:
    """What a case is called that passed, and whose try before ended with this message."""
    return (
        f"passed, but a try before it ended so: {message}. Whether that was the stack, or its"
        " node's memory, is not known: one such end more would have failed it"
    )
