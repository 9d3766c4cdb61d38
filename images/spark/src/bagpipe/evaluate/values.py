"""Criteria over what messages say: bounds of a field, an expression over each message."""

import cel

from bagpipe.evaluate.evidence import Evidence
from bagpipe.evaluate.fields import as_map, number_at
from bagpipe.evaluate.finding import Finding, NoEvidenceError
from bagpipe.evaluate.limits import bounded, limits
from bagpipe.evaluate.model import Expression, FieldBounds

_FAULTS = (LookupError, RuntimeError, TypeError, ValueError)


def bounds(name: str, wanted: FieldBounds, evidence: Evidence) -> Finding:
    """The value that is furthest out. Raises NoEvidenceError for a field that is not there."""
    samples = evidence.recorded.samples(wanted.topic)
    numbers = [(number_at(sample.message, wanted.field), sample.time) for sample in samples]
    worst, at = max(numbers, key=lambda found: _excess(found[0], wanted.min, wanted.max))
    when = (at - evidence.start) / 1e9
    return bounded(
        Finding(name, "bounds", "passed", worst),
        wanted.min,
        wanted.max,
        f"{wanted.field} of {wanted.topic} at {when:.3f} s of {len(numbers)} messages",
    )


def _excess(value: float, least: float | None, most: float | None) -> float:
    """How far a value is beyond its bounds; inside it is below zero, and NaN is furthest out."""
    if value != value:  # noqa: PLR0124
        return float("inf")
    below = least - value if least is not None else float("-inf")
    above = value - most if most is not None else float("-inf")
    return max(below, above)


def expression(name: str, wanted: Expression, evidence: Evidence) -> Finding:
    """The share of messages for which it holds. Raises NoEvidenceError where it can't be told."""
    program = compiled(wanted.holds)
    samples = evidence.recorded.samples(wanted.topic)
    held, first = 0, ""
    for sample in samples:
        seconds = (sample.time - evidence.start) / 1e9
        known = {"msg": as_map(sample.message), "t": seconds, "case": evidence.values}
        try:
            answer = program.execute(known)
        except _FAULTS as error:
            said = str(error).splitlines()[0]
            raise NoEvidenceError(f"{wanted.holds} can't be computed: {said}") from error
        if not isinstance(answer, bool):
            raise NoEvidenceError(
                f"{wanted.holds} gives {answer!r} and neither true nor false: write a comparison"
            )
        held += answer
        if not answer and not first:
            first = f", first not at {seconds:.3f} s"
    share = held / len(samples)
    outcome = "passed" if share >= wanted.share else "failed"
    message = f"{wanted.holds} holds for {held} of {len(samples)} messages on {wanted.topic}{first}"
    return Finding(
        name,
        "expression",
        "passed" if outcome == "passed" else "failed",
        share,
        "",
        limits(wanted.share, None, ""),
        "higher",
        message,
    )


def compiled(text: str) -> cel.Program:
    """Raises NoEvidenceError for a text that is no expression or names what is not known."""
    try:
        program = cel.compile(text)
    except _FAULTS as error:
        said = str(error).splitlines()[0]
        raise NoEvidenceError(f"{text} is no expression: {said}") from error
    macros = any(f".{macro}(" in text for macro in ("all", "exists", "exists_one", "filter", "map"))
    unknown = sorted(set(program.variables()) - {"msg", "t", "case"})
    if unknown and not macros:
        raise NoEvidenceError(
            f"{text} names {', '.join(unknown)}: write msg.<field>, t or case.<variable>"
        )
    return program
