"""How a case of nodes is played, recorded and judged, whatever middleware they speak."""

import posixpath
from collections.abc import Callable

from bagpipe.engine.criteria import judged_by_criteria
from bagpipe.engine.delivery import Unproved, judge
from bagpipe.engine.engine import Attempt, Played
from bagpipe.engine.replay_result import RESULT
from bagpipe.faults import FaultPolicy
from bagpipe.wire.session import Answer, Sink, Sinks, engine_result


def replayed(
    attempt: Attempt,
    exchange: Callable[[Sink | Sinks], Answer],
    ending: str,
    unproved: Unproved | None = None,
) -> Played:
    """Keeps the recording; judges delivery first, then by the job's criteria.

    `ending` is that of the recording's name, `unproved` what is no proof of delivery (None: any
    is one). Raises SessionError and StorageError.
    """
    name = f"{attempt.name}{ending}"
    recorded = posixpath.join(attempt.results, name)
    with attempt.storage.create(recorded) as sink:
        answer = exchange(sink)
        result = engine_result(answer, RESULT)
    spec = attempt.spec
    judgement = judge(result, FaultPolicy(spec.fault_policy), spec.playback.mode, unproved)
    judgement = attempt.source.judge(result, judgement)
    judgement, findings = judged_by_criteria(judgement, attempt, recorded, result)
    return Played(judgement, name, answer, findings)
