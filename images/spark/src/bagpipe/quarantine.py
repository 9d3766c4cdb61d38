"""Cases that flake and don't decide their job's verdict for a while: spec.quarantine. Pure.

What is in quarantine runs, is judged and is reported as every other case. The day on which a job's
rules are looked at is decided once for a job, so that all who read its results read one verdict.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import date, timedelta
from fnmatch import translate
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, Field, field_serializer

from bagpipe.counted import counted
from bagpipe.pod_spec import SPEC_CONFIG
from bagpipe.row_facts import OUTCOMES

Row = Mapping[str, Any]

# A quarter: a fault that was left alone for longer is how the stack is, and somebody has to decide
# so again. It bounds a clock that is late, too: to that one every end seems far away.
MOST_DAYS = 90
_DAY = re.compile(r"20[0-9]{2}-[0-9]{2}-[0-9]{2}")


def _day(written: object) -> object:
    """A day as the CRD takes it: pydantic's own would take seconds since 1970, and times."""
    if type(written) is date:
        return written
    if isinstance(written, str) and _DAY.fullmatch(written):
        try:
            return date.fromisoformat(written)
        except ValueError:
            pass
    raise ValueError(
        "quarantine.until is no day: write the last one on which it holds, such as 2026-12-31"
    )


def _some_words(reason: str) -> str:
    # The API server's regular expressions know no other white space.
    if not reason.strip(" \t\n\f\r"):
        raise ValueError(
            "quarantine.reason is empty: write why the case flakes, or the issue that says so"
        )
    return reason


class QuarantineRule(BaseModel):
    """Which cases, why, and the last day (in UTC) on which it holds."""

    model_config = SPEC_CONFIG

    # Case names as `bagpipe run --cases` takes them: *, ? and [...] match, and the whole name.
    cases: str = Field(min_length=1, max_length=253)
    reason: Annotated[str, AfterValidator(_some_words)] = Field(max_length=500)
    until: Annotated[date, BeforeValidator(_day)]

    @field_serializer("until")
    def _as_written(self, until: date) -> str:
        return until.isoformat()


class QuarantineError(ValueError):
    """A job's quarantine can't be what it says; the sentence says what to write."""


def too_long(rules: Sequence[QuarantineRule], day: date) -> list[str]:
    """A sentence for each rule that would hold for more than MOST_DAYS after that day."""
    last = day + timedelta(days=MOST_DAYS)
    return [
        f"spec.quarantine of {rule.cases!r} holds until {rule.until}, and the job's day is {day}: a"
        f" quarantine lasts at most {MOST_DAYS} days, so write {last} or an earlier day"
        for rule in rules
        if rule.until > last
    ]


class Quarantine:
    """The rules of one job on its day: which cases don't count."""

    def __init__(self, rules: Sequence[QuarantineRule] = (), day: date = date.min) -> None:
        self.rules = tuple(rules)
        self.day = day
        self._patterns = [re.compile(translate(rule.cases)) for rule in rules]

    @classmethod
    def decided(cls, document: Mapping[str, Any] | None) -> Self:
        """The one that a manifest has."""
        if not document:
            return cls()
        named = [{key: rule[key] for key in ("cases", "reason", "until")}
                 for rule in document["rules"]]  # fmt: skip
        rules = [QuarantineRule.model_validate(rule) for rule in named]
        return cls(rules, date.fromisoformat(document["day"]))

    def holds(self, rule: QuarantineRule) -> bool:
        """Whether a rule has not ended."""
        return self.day <= rule.until

    def matching(self, case: str) -> list[int]:
        """The numbers of all rules that name the case, also of those that have ended."""
        return [at for at, pattern in enumerate(self._patterns) if pattern.match(case)]

    def rule_of(self, case: str) -> QuarantineRule | None:
        """The first rule that holds and names the case."""
        rules = (self.rules[at] for at in self.matching(case))
        return next((rule for rule in rules if self.holds(rule)), None)

    def marked(self, row: Row) -> dict[str, Any]:
        """The row as this job's results have it: what another job made of it is left out."""
        plain = {key: value for key, value in row.items() if key != "quarantine"}
        rule = self.rule_of(str(row["case"]))
        return plain if rule is None else plain | {"quarantine": rule.model_dump()}


def planned(rules: Sequence[QuarantineRule], cases: Sequence[str], day: date) -> dict[str, Any]:
    """What a job of these cases would have in quarantine if it began on that day: `day`, how many
    `cases`, and for each of `rules` how many it names and what is to be done about it.
    """
    quarantine = Quarantine(rules, day)
    inside = [case for case in cases if quarantine.rule_of(case) is not None]
    named = Counter(at for case in cases for at in quarantine.matching(case))
    kept = Counter(at for case in inside for at in quarantine.matching(case))
    return {
        "day": day.isoformat(),
        "cases": len(inside),
        "rules": [
            rule.model_dump()
            | {"named": named[at], "toDo": _before(quarantine, rule, named[at], kept[at])}
            for at, rule in enumerate(rules)
        ],
    }


def _before(quarantine: Quarantine, rule: QuarantineRule, named: int, kept: int) -> str:
    """What is to be done about a rule before its job runs; empty for nothing.

    Of the cases that it has `named`, so many are `kept` in quarantine, by whichever rule.
    """
    if wrong := too_long([rule], quarantine.day):
        return wrong[0]
    if not named:
        return "names no case of this job: correct its pattern, or remove it"
    if quarantine.holds(rule):
        return ""
    if kept:
        return f"ended with {rule.until}: {_counted(named - kept)}{_by_others(kept)}"
    return f"ended with {rule.until}: its cases count"


class QuarantineTally:
    """Counts what became of the cases that each rule names."""

    def __init__(self, quarantine: Quarantine) -> None:
        self._quarantine = quarantine
        self._outcomes: list[Counter[str]] = [Counter() for _ in quarantine.rules]
        # Of the cases that each rule names those that one holds, whichever it is.
        self._inside: Counter[int] = Counter()

    def add(self, row: Row) -> None:
        """One row that counts for the job."""
        inside = self._quarantine.rule_of(str(row["case"])) is not None
        for at in self._quarantine.matching(str(row["case"])):
            self._outcomes[at][str(row["outcome"])] += 1
            self._inside[at] += inside

    def as_json(self) -> dict[str, Any] | None:
        """`day` and `rules`, as the manifest has them; None without rules.

        Each rule has how many of its cases came to which outcome, and `holds`: false where it has
        ended, so that its cases count, but for those that are `inside` by another rule.
        """
        if not self._quarantine.rules:
            return None
        return {
            "day": self._quarantine.day.isoformat(),
            "rules": [
                rule.model_dump()
                | {"holds": self._quarantine.holds(rule), "inside": self._inside[at]}
                | {outcome: self._outcomes[at][outcome] for outcome in OUTCOMES}
                for at, rule in enumerate(self._quarantine.rules)
            ],
        }


def remark(rule: Mapping[str, Any]) -> str:
    """What somebody may have to do about a rule, as a manifest has it; empty for nothing."""
    cases = sum(int(rule[outcome]) for outcome in OUTCOMES)
    noun = counted(cases, "case")
    if not cases:
        return "names no case of this job: correct its pattern, or remove it"
    if not rule["holds"] and (kept := int(rule.get("inside") or 0)):
        return f"ended with {rule['until']}: {_counted(cases - kept)}{_by_others(kept)}"
    if not rule["holds"]:
        return f"ended with {rule['until']}: its {noun} {'counts' if cases == 1 else 'count'} again"
    if rule["passed"] == cases:
        return f"its {noun} passed in this job: `bagpipe history` says whether it could end"
    return ""


def _counted(cases: int) -> str:
    return f"{cases:,} of its cases {'counts' if cases == 1 else 'count'}"


def _by_others(cases: int) -> str:
    return f", and {cases:,} {'is' if cases == 1 else 'are'} in quarantine by another rule"


def remarks(document: Mapping[str, Any] | None) -> list[str]:
    """A sentence for each rule about which somebody may have to do something."""
    found = [(rule, remark(rule)) for rule in (document or {}).get("rules") or []]
    return [f"quarantine of {rule['cases']!r}: {words}" for rule, words in found if words]
