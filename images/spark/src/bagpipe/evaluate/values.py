"""Criteria over what messages say: bounds of a field, an expression over each message."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from time import monotonic
from typing import Any

from bagpipe.evaluate.decoding import base_type
from bagpipe.evaluate.evidence import Evidence, Sample
from bagpipe.evaluate.fields import as_map, names_in, no_number, number_at, single
from bagpipe.evaluate.finding import Finding, NoEvidenceError, covering
from bagpipe.evaluate.limits import bounded, limits
from bagpipe.evaluate.model import Expression, FieldBounds
from bagpipe.evaluate.reads import never_equal, number_below, paths_of
from bagpipe.evaluate.window import TopicMessages, messages_of, over_window, samples
from bagpipe.expressions import Expression as Compiled
from bagpipe.expressions import ExpressionError, UnknownNamesError

# For all messages of one criterion: macros within macros take as long as lists of the stack's are.
MOST_SECONDS = 120.0


def bounds(name: str, wanted: FieldBounds, evidence: Evidence) -> Finding:
    """The value that is furthest out. Raises NoEvidenceError for a field that is not there."""
    found = messages_of(wanted.topic, evidence)
    numbers = [
        (sample.time, number_at(sample.message, wanted.field))
        for sample in samples(found, evidence)
    ]
    what = f"{wanted.field} of {wanted.topic}"
    finding = no_number(name, "bounds", what, numbers, evidence.start)
    if finding is None:
        least, most = _bounds_of(wanted, found)
        at, worst = max(numbers, key=lambda pair: _excess(pair[1], least, most))
        when = (at - evidence.start) / 1e9
        finding = bounded(
            Finding(name, "bounds", "passed", worst),
            least,
            most,
            f"{what} at {when:.3f} s of {len(numbers)} messages",
        )
        finding = replace(finding, figure=float(worst))
    return _covering(finding, found, evidence, wanted.min_coverage, lasting=True)


def _covering(
    finding: Finding, found: TopicMessages, evidence: Evidence, least: float, *, lasting: bool
) -> Finding:
    share, covered = over_window(found, evidence, least)
    remedy = "of a topic that is silent on purpose lower minCoverage"
    return covering(finding, share, covered, found.clock, least, lasting=lasting, remedy=remedy)


def _bounds_of(wanted: FieldBounds, found: TopicMessages) -> tuple[float | None, float | None]:
    """As the field has them: in 32 bits 0.6 is a little more, and is no more than its bound."""
    given = (wanted.min, wanted.max)
    least, most = (None if each is None else single(each) for each in given)
    if (least, most) == given or not _in_single(found, names_in(wanted.field)):
        return given
    return least, most


def _in_single(found: TopicMessages, path: Sequence[str | int]) -> bool:
    """Whether the number at a path has 32 bits in all messages."""
    names = [part for part in path if isinstance(part, str)]
    connections = {each.connection.id: each.connection for each in found.answers}
    return all(base_type(each, names) == "float32" for each in connections.values())


def _excess(value: float, least: float | None, most: float | None) -> tuple[bool, float]:
    """Whether a value is beyond its bounds, and how far, as exactly as a float can say that."""
    least = -math.inf if least is None else least
    most = math.inf if most is None else most
    return not least <= value <= most, max(least - value, value - most)


def expression(name: str, wanted: Expression, evidence: Evidence) -> Finding:
    """The share of messages for which it holds. Raises NoEvidenceError where that is unknown."""
    program = compiled(wanted.holds)
    found = messages_of(wanted.topic, evidence)
    answers = samples(found, evidence)
    first = as_map(answers[0].message)
    if vain := never_equal(wanted.holds, first, partial(_in_single, found)):
        raise NoEvidenceError(f"{wanted.holds} {vain}: write a value of its own type")
    finding = _odd(name, wanted, answers, evidence.start)
    if finding is None:
        finding = _holds(name, wanted, program, answers, evidence)
    return _covering(finding, found, evidence, wanted.min_coverage, lasting=wanted.share == 1.0)


def _odd(name: str, wanted: Expression, answers: list[Sample], start: int) -> Finding | None:
    """Looked for before the expression is computed: CEL can't compare what is no number."""
    read = paths_of(wanted.holds) if wanted.finite else []
    # Of one message at a time: a map is many times as large as the message that it is made of.
    maps = ((each.time, as_map(each.message)) for each in answers if read)
    numbers = [(at, number_below(message, path)) for at, message in maps for path in read]
    what = f"what {wanted.holds} reads of {wanted.topic}"
    return no_number(name, "expression", what, numbers, start)


def _holds(
    name: str,
    wanted: Expression,
    program: Compiled,
    answers: list[Sample],
    evidence: Evidence,
) -> Finding:
    found = _answers(program, answers, evidence)
    count = sum(holds for _, holds in found)
    # Whatever the rest would be, no more than this can hold.
    most = (len(answers) - len(found) + count) / len(answers)
    if len(found) < len(answers) and most >= wanted.share:
        raise NoEvidenceError(
            f"{program.text} took over {MOST_SECONDS:g} s for {len(found)} of {len(answers)}"
            " messages: nest no macros, or compute it in an evaluator of your own"
        )
    evidence.keep(wanted, found)
    missed = next((at for at, holds in found if not holds), None)
    first = "" if missed is None else f", first not at {(missed - evidence.start) / 1e9:.3f} s"
    share: float | None = count / len(found)
    of = f"{count} of {len(answers)} messages"
    if len(found) < len(answers):
        # How far it came is the machine's: the share of that is no figure of the stack.
        share = None
        of = f"{count} of the first {len(found)} of {len(answers)} messages"
        first += f"; for those it took over {MOST_SECONDS:g} s"
    return Finding(
        name,
        "expression",
        "passed" if share is not None and share >= wanted.share else "failed",
        share,
        "",
        limits(wanted.share, None, ""),
        "higher",
        f"{wanted.holds} holds for {of} on {wanted.topic}{first}",
    )


def _answers(
    program: Compiled, answers: list[Sample], evidence: Evidence
) -> list[tuple[int, bool]]:
    """As far as MOST_SECONDS go; the message at hand is computed to its end."""
    found: list[tuple[int, bool]] = []
    begun = monotonic()
    for each in answers:
        if monotonic() - begun > MOST_SECONDS:
            break
        found.append((each.time, _answer(program, as_map(each.message), each.time, evidence)))
    return found


def held(wanted: Expression, evidence: Evidence) -> list[tuple[int, bool]]:
    """Times of receipt in ns, and whether it held, once the criterion was judged; else nothing."""
    return evidence.kept(wanted) or []


def _answer(program: Compiled, message: Any, at: int, evidence: Evidence) -> bool:
    seconds = (at - evidence.start) / 1e9
    try:
        return program.holds({"msg": message, "t": seconds, "case": evidence.values})
    except ExpressionError as error:
        raise NoEvidenceError(f"{program.text} {error}") from error


def compiled(text: str) -> Compiled:
    """Raises NoEvidenceError for a text that is no expression or names what is not known."""
    try:
        return Compiled.compiled(text, ("msg", "t", "case"))
    except UnknownNamesError as error:
        raise NoEvidenceError(f"{text} {error}: write msg.<field>, t or case.<variable>") from error
    except ExpressionError as error:
        raise NoEvidenceError(f"{text} {error}") from error
