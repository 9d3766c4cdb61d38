"""What rounds of the liars come to: both kinds of errors, and answers that flipped. Pure."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from scipy.stats import binomtest

from tests.bench.rows import Row
from tests.liars.row import Row as Stack

if TYPE_CHECKING:
    from tests.liars.army import Army

# Outcome and reason, as the gate says them; no answer where the stack itself did not run.
Answer = tuple[str, str]
NOT_RUN: Answer = ("errored", "NotRun")


def answer_of(army: "Army", stack: Stack) -> Answer:
    """What the gate says of a stack; a run without the stack's marks says nothing of it."""
    result = army.result_of(stack)
    ran = all(result.marks.get(mark) for mark in stack.marks)
    return (result.outcome, result.reason) if ran or result.outcome == "passed" else NOT_RUN


class Tally:
    """Answers of all rounds, by stack."""

    def __init__(self, stacks: Iterable[Stack]) -> None:
        self._stacks = list(stacks)
        self._answers: dict[str, list[Answer]] = {stack.name: [] for stack in self._stacks}

    def add(self, answers: Mapping[str, Answer]) -> None:
        """One round."""
        for name, answer in answers.items():
            self._answers[name].append(answer)

    def count(self, outcomes: set[str], honest: bool) -> int:
        """How many runs of liars, or of honest stacks, ended so."""
        return sum(outcome in outcomes for outcome, _ in self._of(honest))

    def runs(self, honest: bool) -> int:
        return len(self._of(honest))

    def flips(self) -> dict[str, Counter[Answer]]:
        """The stacks whose answer was not the same in all rounds."""
        counted = {name: Counter(answers) for name, answers in self._answers.items()}
        return {name: answers for name, answers in counted.items() if len(answers) > 1}

    def errors(self) -> dict[str, Counter[Answer]]:
        """The stacks that were taken for what they are not, with those answers."""
        found = {}
        for stack in self._stacks:
            wrong = {"failed", "invalid"} if stack.honest else {"passed"}
            answers = Counter(a for a in self._answers[stack.name] if a[0] in wrong)
            if answers:
                found[stack.name] = answers
        return found

    def headline(self) -> str:
        """Both error rates in a line."""
        return (
            f"{self.count({'passed'}, honest=False)} of {self.runs(False)} runs of liars passed,"
            f" {self.count({'failed', 'invalid'}, honest=True)} of {self.runs(True)} runs of"
            f" honest stacks were refused, without an answer {self.count({'errored'}, False)}"
            f" and {self.count({'errored'}, True)}"
        )

    def report(self) -> str:
        """Both error rates with their intervals, each error, and each answer that flipped."""
        lines = [
            "| | runs | errors | share | 95 % interval | without an answer |",
            "|---|---|---|---|---|---|",
            self._line("liars passed", {"passed"}, honest=False),
            self._line("honest refused", {"failed", "invalid"}, honest=True),
        ]
        for title, found in (("errors", self.errors()), ("answers that flipped", self.flips())):
            lines += ["", f"{title}: {len(found) or 'none'}"]
            lines += [f"- {name}: {_in_words(answers)}" for name, answers in found.items()]
        return "\n".join(lines)

    def rows(self) -> list[Row]:
        """For the file of results: one figure for each round."""
        counted = [
            ("liars", "passed", self._each(False, {"passed"})),
            ("honest", "refused", self._each(True, {"failed", "invalid"})),
            ("liars", "no answer", self._each(False, {"errored"})),
            ("honest", "no answer", self._each(True, {"errored"})),
        ]
        return [Row(case, metric, "runs", runs, "-", []) for case, metric, runs in counted]

    def _of(self, honest: bool) -> list[Answer]:
        of = [stack.name for stack in self._stacks if stack.honest == honest]
        return [answer for name in of for answer in self._answers[name]]

    def _each(self, honest: bool, outcomes: set[str]) -> list[float]:
        of = [self._answers[stack.name] for stack in self._stacks if stack.honest == honest]
        return [sum(a[0] in outcomes for a in round_) for round_ in zip(*of, strict=True)]

    def _line(self, title: str, outcomes: set[str], honest: bool) -> str:
        errors, runs = self.count(outcomes, honest), self.runs(honest)
        silent = self.count({"errored"}, honest)
        if not runs:
            return f"| {title} | 0 | - | - | - | - |"
        between = binomtest(errors, runs).proportion_ci(method="exact")
        return (
            f"| {title} | {runs} | {errors} | {errors / runs:.2%}"
            f" | {between.low:.2%} to {between.high:.2%} | {silent} |"
        )


def _in_words(answers: Counter[Answer]) -> str:
    return ", ".join(f"{n} x {' '.join(a).strip()}" for a, n in answers.most_common())
