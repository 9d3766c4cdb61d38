"""How a case of nodes is played, recorded and judged, whatever middleware they speak."""

import posixpath
from collections.abc import Callable

from bagpipe.engine.criteria import judged_by_criteria
from bagpipe.engine.delivery import Proof, judge
from bagpipe.engine.engine import Attempt, Played
from bagpipe.engine.moment_images import images_of
from bagpipe.engine.replay_result import RESULT
from bagpipe.evaluate.evidence import Recording
from bagpipe.evaluate.written import TOPIC, written
from bagpipe.faults import FaultPolicy
from bagpipe.wire.session import Answer, Sink, Sinks, engine_result

# A recording is at most 1 GiB of messages; its bag has some headers more.
_MOST_RECORDED_BYTES = 5 << 28


def replayed(
    attempt: Attempt,
    exchange: Callable[[Sink | Sinks], Answer],
    ending: str,
    proof: Proof | None = None,
) -> Played:
    """Keeps the recording; judges delivery first, then by the job's criteria.

    `ending` is that of the recording's name, `proof` what proves a delivery (None: whatever the
    ledger says). Raises SessionError and StorageError.
    """
    name = f"{attempt.name}{ending}"
    recorded = posixpath.join(attempt.results, name)
    with attempt.storage.create(recorded) as sink:
        answer = exchange(sink)
        result = engine_result(answer, RESULT)
    spec = attempt.spec
    if proof is not None:
        proof.mark(result)
    judgement = judge(result, FaultPolicy(spec.fault_policy), spec.playback.mode, proof)
    judgement = attempt.source.judge(result, judgement)
    # Read when a criterion asks for it, or when there is a log in it.
    recording = Recording(
        lambda: attempt.storage.read_all(recorded, _MOST_RECORDED_BYTES),
        attempt.case.window.start,
        None,
    )
    judgement, findings = judged_by_criteria(judgement, attempt, recording, result)
    log = []
    if any(topic["topic"] == TOPIC for topic in result["recorded"]["topics"]):
        passed = judgement.outcome == "passed"
        log = written(recording, attempt.case.window.start, passed=passed)
    images = images_of(attempt, recording, result, findings)
    return Played(judgement, name, answer, findings, log, images)
