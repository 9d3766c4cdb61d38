"""A case's criteria: what they read is fetched from storage only when one of them asks for it."""

import io
from collections.abc import Callable
from typing import Any

from bagpipe.evaluate.evidence import Evidence, Recording
from bagpipe.evaluate.finding import verdict
from bagpipe.evaluate.judge import evaluate
from bagpipe.evaluate.model import Criterion, topics_of
from bagpipe.pipe.frames import MAX_PAYLOAD_BYTES
from bagpipe.plan.bag_head import unindexed_head
from bagpipe.plan.bag_tail import read_tail
from bagpipe.plan.cases import Case
from bagpipe.plan.fragments import holding
from bagpipe.run.inputs import input_times
from bagpipe.run.judge import Judgement
from bagpipe.run.pieces import sequence_bag
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage

# A recording is at most 1 GiB of messages; its bag has some headers more.
_MOST_RECORDED_BYTES = 5 << 28
_NOTHING_SHOWN = {"NothingPlayed", "NothingRecorded", "NothingAnswered"}


def judged_by_criteria(
    judgement: Judgement,
    case: Case,
    spec: SimulationJobSpec,
    storage: Storage,
    recorded: str,
    result: dict[str, Any],
) -> tuple[Judgement, list[dict[str, Any]]]:
    """The verdict on a delivered case, and the findings behind it, as the results have them.

    Without criteria the delivery alone is judged; a case in which nothing was played or recorded,
    or whose stack has failed, is what it is whatever its criteria say.
    """
    if not spec.evaluate or judgement.outcome in {"failed", "errored"}:
        return judgement, []
    if judgement.reason in _NOTHING_SHOWN:
        return judgement, []
    evidence = Evidence(
        # To the end of the drain: what of it belongs to the window is told by each criterion's
        # clock (bagpipe.evaluate.window).
        recorded=Recording(
            lambda: storage.read_all(recorded, _MOST_RECORDED_BYTES), case.window.start, None
        ),
        source=Recording(
            lambda: _source(case, spec.evaluate, storage), case.window.start, case.window.end
        ),
        start=case.window.start,
        end=case.window.end,
        result=result,
        values=case.conditions.values,
        lead_in_start=case.window.lead_in_start,
        paced=spec.playback.mode != "max",
        inputs=_inputs(case, spec, storage),
    )
    findings = evaluate(spec.evaluate, evidence)
    outcome, reason, message = verdict(findings)
    judged = Judgement(outcome, reason, message, judgement.allowed)
    return judged, [finding.as_row() for finding in findings]


def _inputs(
    case: Case, spec: SimulationJobSpec, storage: Storage
) -> Callable[[], list[int]] | None:
    """None for a simulator, which is never silent."""
    if spec.source.simulator is not None:
        return None
    return lambda: input_times(case, spec.source.topics, storage)


def _source(case: Case, criteria: list[Criterion], storage: Storage) -> bytes:
    """The part of the case's own bag that holds the criteria's truth, as a bag without an index;
    a sequence whole.
    """
    if case.parts:
        return sequence_bag(case, storage).to_bytes()
    file = storage.open(case.bag)
    tail = read_tail(file.read, file.size)
    wanted = {topic for criterion in criteria for topic in topics_of(criterion)[1]}
    of_truth = {c.id for c in tail.connections if c.topic in wanted}
    ranges = [(c.offset, c.length) for c in tail.connections]
    ranges += [
        (chunk.offset, chunk.end - chunk.offset)
        for chunk in tail.chunks
        if of_truth & holding(chunk)
        and chunk.start_time < case.window.end
        and chunk.end_time >= case.window.start
    ]
    bag = io.BytesIO()
    bag.write(unindexed_head())
    for piece in storage.pieces(case.bag, ranges, MAX_PAYLOAD_BYTES, case.bag_version):
        bag.write(piece)
    return bag.getvalue()
