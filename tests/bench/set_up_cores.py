"""What more processors would gain: make's graph of steps, played through with measured times.

    python -m tests.bench.set_up_cores STEPS [--goal demo] [--processors 2 4 8]

STEPS is what BAGPIPE_STEPS named while the goal was made: lines of JSON with what a step is, its
seconds, and those of a processor. What depends on what is asked of make. A step computes for as
long as its processor's seconds last, on at most so many processors as it can use, shared with those
that run beside it by their priority; what is served by processes that it does not wait for takes
the time that it took. The first row is the machine that was measured: how far the model is from it.
"""

import argparse
import json
import os
import re
import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
# How many processors a step can use, and the priority that the Makefile gives it; others use one.
# Of images as many are built at once as there are processors, but most wait for the agent's.
WIDE = {
    "Building Kubernetes": (64, 19),
    "Building the agent": (8, 0),
    "Building images": (3, 15),
    "Compiling the agent's tests": (8, 0),
    "Building what tests start": (8, 10),
}
# Kubernetes and its pods compute here, and no step waits for those processes.
SERVED = frozenset(
    {
        "Starting Kubernetes on this machine",
        "Loading images",
        "Installing the chart",
        "Running the demonstration",
    }
)
# A processor's share for each degree of niceness, as the kernel's scheduler has it.
_WEIGHT = 1.25


@dataclass(frozen=True)
class Step:
    """`work` in seconds of a processor, of which it uses at most `width`; `fixed` in seconds."""

    name: str
    after: frozenset[str]
    work: float = 0.0
    fixed: float = 0.0
    width: float = 1.0
    niceness: int = 0


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("steps", type=Path)
    parser.add_argument("--goal", default="demo")
    parser.add_argument("--processors", type=int, nargs="+", default=[2, 4, 8])
    given = parser.parse_args()
    measured = [json.loads(line) for line in given.steps.read_text().splitlines()]
    steps = weighed(graph(database(given.goal), given.goal), measured)
    took = max(step["ended"] for step in measured) - min(
        step["ended"] - step["seconds"] for step in measured
    )
    print(f"{'measured':>14}  {took:6.0f} s")
    for processors in given.processors:
        ends = simulate(steps, processors)
        last = max(ends, key=lambda name: ends[name])
        print(f"{processors:3} processors  {ends[last]:6.0f} s")
        for name in critical(steps, ends, last):
            print(f"{'':16}{ends[name]:6.0f} s  {name}")


def database(goal: str) -> str:
    """What make knows before it makes the goal, with nothing made."""
    environment = {name: text for name, text in os.environ.items() if name != "MAKEFLAGS"}
    environment["BAGPIPE_STEPS"] = os.devnull  # else make overwrites the file that is read here
    done = subprocess.run(
        ["make", "-npq", "--always-make", goal],
        cwd=ROOT, env=environment, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    return done.stdout


def graph(text: str, goal: str) -> dict[str, frozenset[str]]:
    """The steps that a goal needs, each with those that must end before it, by their names.

    Raises ValueError where make has no such goal.
    """
    needs: dict[str, list[str]] = {}
    says: dict[str, str] = {}
    target = ""
    for line in text.partition("\n# Files")[2].splitlines():
        if found := re.match(r"([^\s#:=]+):(?!=) ?(.*)", line):
            target = found[1]
            needs[target] = [word for word in found[2].split() if word != "|"]
        elif line.startswith("\t$(call SYNC"):
            says.setdefault(target, "Making .venv from uv.lock")
        elif step := re.match(r'\t\$\(STEP\) "([^"]+)"', line):
            says.setdefault(target, step[1])
    if goal not in needs:
        raise ValueError(f"make has no goal {goal}")
    steps: dict[str, frozenset[str]] = {}

    def visit(target: str) -> frozenset[str]:
        before = frozenset[str]().union(*(visit(need) for need in needs.get(target, [])))
        if target not in says:
            return before
        steps[says[target]] = before
        return frozenset({says[target]})

    visit(goal)
    return steps


def weighed(
    steps: Mapping[str, frozenset[str]], measured: Iterable[Mapping[str, float | str]]
) -> list[Step]:
    """The graph's steps with what they took; one that did not run takes no time."""
    took = {str(step["what"]): step for step in measured}
    found = []
    for name, after in steps.items():
        seconds = float(took[name]["seconds"]) if name in took else 0.0
        work = float(took[name]["processor"]) if name in took else 0.0
        width, niceness = WIDE.get(name, (1, 0))
        if name in SERVED:
            found.append(Step(name, after, fixed=seconds))
        else:
            found.append(Step(name, after, work=work, width=width, niceness=niceness))
    return found


def simulate(steps: Iterable[Step], processors: float) -> dict[str, float]:
    """When each step ends, in seconds, if each begins as soon as those before it have ended.

    Raises ValueError where steps wait for each other, or for one that is not there.
    """
    waiting = {step.name: step for step in steps}
    left: dict[str, list[float]] = {}
    running: dict[str, Step] = {}
    ends: dict[str, float] = {}
    now = 0.0
    while waiting or running:
        for step in [step for step in waiting.values() if step.after <= ends.keys()]:
            running[step.name] = waiting.pop(step.name)
            left[step.name] = [step.work, step.fixed]
        if not running:
            raise ValueError(f"these wait for ever: {sorted(waiting)}")
        speeds = shares(running.values(), processors)
        until = {
            name: max(work / speeds[name] if work else 0.0, fixed)
            for name, (work, fixed) in left.items()
        }
        passed = min(until.values())
        now += passed
        for name, (work, fixed) in list(left.items()):
            left[name] = [work - passed * speeds[name], fixed - passed]
            if until[name] <= passed:
                ends[name] = now
                del running[name], left[name]
    return ends


def shares(running: Iterable[Step], processors: float) -> dict[str, float]:
    """How many processors each has: by weight, and what one can't use goes to the others."""
    open_ = {step.name: step for step in running}
    speeds: dict[str, float] = {}
    while open_:
        weights = {name: _WEIGHT**-step.niceness for name, step in open_.items()}
        one = (processors - sum(speeds.values())) / sum(weights.values())
        full = [name for name, step in open_.items() if step.width <= weights[name] * one]
        if not full:
            return speeds | {name: weight * one for name, weight in weights.items()}
        for name in full:
            speeds[name] = open_.pop(name).width
    return speeds


def critical(steps: Iterable[Step], ends: Mapping[str, float], last: str) -> list[str]:
    """The chain of steps that each waited for the one before it, in their order."""
    after = {step.name: step.after for step in steps}
    chain = [last]
    while before := after[chain[0]]:
        chain.insert(0, max(before, key=lambda name: ends[name]))
    return chain


if __name__ == "__main__":
    main()
