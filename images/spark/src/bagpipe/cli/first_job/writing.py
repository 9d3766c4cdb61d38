"""A proposal as the text of a manifest. What a recording says stands there in ASCII alone: neither
YAML nor a terminal takes any of it for its own.
"""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import yaml

from bagpipe.cli.first_job.facts import Recordings, Topic
from bagpipe.cli.first_job.proposing import Proposal
from bagpipe.engine_fields import fields_of
from bagpipe.quantities import size

CHANGE = "# CHANGE:"
_PLACEHOLDER_IMAGE = "registry.example/your-stack:1"
_MOST_ROWS = 100
_MOST_REFUSED = 10
_LONGEST = 160


@dataclass(frozen=True)
class Written:
    """What the text says beside the job: `lines` about how to run it, and about the image."""

    how: list[str]
    image: list[str]


def printable(text: str, longest: int = _LONGEST) -> str:
    """A text of any kind on one line, in ASCII, with escapes in place of all else."""
    plain = text.encode("unicode_escape").decode("ascii")
    return plain if len(plain) <= longest else f"{plain[:longest]}..."


def quoted(text: str) -> str:
    """A text as YAML has it in double quotes, in ASCII, on one line."""
    dumped: str = yaml.safe_dump(text, default_style='"', width=1 << 20)
    return dumped.removesuffix("\n")


def manifest(proposal: Proposal, recordings: Recordings, beside: Written) -> str:
    """The manifest, with comments."""
    lines = [*_head(beside), *_shown(recordings, proposal)]
    lines += ["apiVersion: sim.bagpipe.io/v1alpha1", "kind: SimulationJob"]
    lines += [f"metadata: {{name: {quoted(proposal.asked.name)}}}", "spec:"]
    for part in (_source, _stack, _playback, _record, _evaluate, _resources):
        lines += [f"  {line}".rstrip() for line in part(proposal, beside)]
    lines += ["  output:", f"    uri: {quoted(f'pvc://results/{proposal.asked.name}')}"]
    return "\n".join(lines) + "\n"


def _head(beside: Written) -> Iterator[str]:
    yield "# Written by `bagpipe init` from what recordings show. Lines with CHANGE are guesses,"
    yield "# or what no recording shows."
    yield "#"
    for line in beside.how:
        yield f"#   {line}"
    yield "#"


def _shown(recordings: Recordings, proposal: Proposal) -> Iterator[str]:
    looked = recordings.looked
    for each in looked[:_MOST_REFUSED]:
        yield (
            f"# {printable(each.uri)}: {each.kind}, {size(each.bytes)}, {each.seconds:.1f} s, by"
            f" its {each.basis}"
        )
    rest = len(looked) - _MOST_REFUSED
    if rest > 0:
        yield f"# and {rest} more, {recordings.seconds:.1f} s in all"
    unseen = recordings.named - len(looked) - len(recordings.refused)
    if unseen:
        yield f"# {unseen} of {recordings.named} recordings were not looked into"
    for sentence in recordings.refused[:_MOST_REFUSED]:
        yield f"# CAN'T BE PLAYED: {printable(sentence)}"
    yield "#"
    yield from _table(recordings.topics.values(), set(proposal.unfit))
    yield "#"


def _table(topics: Iterable[Topic], unfit: set[str]) -> Iterator[str]:
    rows = list(topics)
    yield f"# {'per second':>10}  {'messages':>10}  {'bytes each':>10}  topic, type"
    for topic in rows[:_MOST_ROWS]:
        rate = "-" if topic.rate is None else f"{topic.rate:.3g}"
        each = "-" if topic.bytes_each is None else f"{topic.bytes_each:,.0f}"
        marks = ", latched" if topic.latched else ""
        marks += ", CAN'T BE PLAYED" if topic.name in unfit else ""
        kinds = " ".join(printable(kind or "(no type)") for kind in sorted(topic.types)[:3])
        yield (
            f"# {rate:>10}  {topic.messages:>10,}  {each:>10}  {printable(topic.name)}"
            f"  {kinds}{marks}"
        )
    if len(rows) > _MOST_ROWS:
        yield f"# and {len(rows) - _MOST_ROWS} more topics: `bagpipe bag info` lists all"


def _source(proposal: Proposal, _beside: Written) -> Iterator[str]:
    yield "source:"
    yield "  bags:"
    for uri in proposal.asked.bags:
        yield f"  - {quoted(uri)}"
    if proposal.topics:
        if not proposal.asked.inputs:
            yield f"  {CHANGE} leave out what your stack does not subscribe to"
        yield "  # Each must find a subscriber, or the case ends as NeverSubscribed."
        yield "  topics:"
        for topic in proposal.topics:
            yield f"  - {quoted(topic)}"
    else:
        yield "  # All topics are played. Name those that your stack subscribes to, to read less:"
        yield "  # topics: [/camera/image, /imu/data]"
    memory = proposal.memory
    yield f"  # The fullest fragment reads about {size(memory.fragment)} as it is stored."
    warm_up = f", warmUp: {_duration(proposal.warm_up)}" if proposal.warm_up else ""
    yield f"  fragment: {{length: {_duration(proposal.length)}{warm_up}}}"


def _stack(proposal: Proposal, beside: Written) -> Iterator[str]:
    asked, engine = proposal.asked, proposal.engine
    yield "stack:"
    yield f"  engine: {engine}"
    if not asked.image:
        yield f"  {CHANGE} your image, unmodified"
    for line in beside.image:
        yield f"  # {printable(line)}"
    yield f"  image: {quoted(asked.image or _PLACEHOLDER_IMAGE)}"
    if not asked.command:
        yield f"  {CHANGE} what starts your nodes, word by word"
    example = fields_of(engine).example
    words = asked.command or (example.command if example else ("your-program",))
    yield f"  command: [{', '.join(map(quoted, words))}]"
    if example:
        yield "  # So that the stack's clock is the recording's."
        yield f"  parameters: {{{quoted(example.sim_time)}: true}}"
    if proposal.remap:
        yield "  # The recorded outputs are played under names that no node has: yours count."
        yield "  remap:"
        for stack, recorded in proposal.remap.items():
            yield f"    {quoted(stack)}: {quoted(recorded)}"
    yield from (f"  {line}" for line in _memory(proposal))


def _memory(proposal: Proposal) -> Iterator[str]:
    memory = proposal.memory
    yield "# Of one case: its fragment as it is stored and unpacked, what the stack publishes, and"
    yield (
        f"# 1 GiB for the stack itself: {size(memory.fragment)} + {size(memory.unpacked)} +"
        f" {size(memory.recorded)} + 1 GiB, and 64 MiB of pipes."
    )
    for assumed in memory.assumed:
        yield f"# Assumed: {assumed}."
    yield f"{CHANGE} what your stack needs; results say what each case used (stack.usage)"
    yield "resources:"
    yield '  requests: {cpu: "1"}'
    yield f"  limits: {{memory: {memory.whole >> 20}Mi}}"


def _playback(proposal: Proposal, _beside: Written) -> Iterator[str]:
    yield "# max plays as fast as the stack takes it, lockstep records the same bytes in each run."
    asked = proposal.asked
    if not asked.steps:
        yield f"playback: {{mode: {asked.mode}}}"
        return
    yield "playback:"
    yield f"  mode: {asked.mode}"
    yield "  # After a trigger's message the next message waits for the answer, and this long."
    yield "  steps:"
    played = {recorded: name for name, recorded in proposal.remap.items()}
    for trigger, answer in asked.steps:
        step = {"trigger": played.get(trigger, trigger), "answer": answer, "deadline": "2s"}
        yield f"  - {_flow(step)}"


def _record(proposal: Proposal, _beside: Written) -> Iterator[str]:
    outputs = proposal.asked.outputs
    if outputs:
        yield "record:"
        yield "  topics:"
        yield from (f"  - {quoted(topic)}" for topic in outputs)
        return
    yield f"{CHANGE} what your stack publishes: `bagpipe init --output TOPIC` writes criteria, too"
    yield 'record: {topics: ["/.*"]}'


def _evaluate(proposal: Proposal, _beside: Written) -> Iterator[str]:
    for sentence in proposal.without:
        yield f"# {printable(sentence)}."
    if not proposal.criteria:
        yield "# A case passes when its stack got every message and published something. Criteria:"
        yield "# evaluate:"
        yield "# - {name: rate, rate: {topic: /your/output, min: 9.5}}"
        return
    yield "# From what the recordings show of these topics. docs/tasks/criteria.md has more kinds."
    yield "evaluate:"
    for proposed in proposal.criteria:
        yield f"# {proposed.why}"
        yield f"- {_flow(proposed.criterion)}"


def _resources(_proposal: Proposal, _beside: Written) -> Iterator[str]:
    yield "# Executors times slots cases run side by side; the slots of one share a container."
    yield "spark: {executors: 1, slots: 1}"


def _flow(value: dict[str, Any]) -> str:
    parts = (
        f"{key}: {_flow(item) if isinstance(item, dict) else _scalar(item)}"
        for key, item in value.items()
    )
    return f"{{{', '.join(parts)}}}"


def _scalar(value: Any) -> str:
    return quoted(value) if isinstance(value, str) else json.dumps(value)


def _duration(seconds: float) -> str:
    return f"{seconds:g}s" if seconds == int(seconds) else f"{round(seconds * 1000)}ms"
