"""The process around a user's evaluator: `python -I -m bagpipe.evaluate.own_process FILE`.

It reads the request from stdin and writes the answer as JSON to stdout; what the user's code
prints goes to stderr.
"""

import importlib.util
import json
import os
import resource
import sys
from pathlib import Path
from typing import Any

from bagpipe.evaluate.evidence import Evidence, Recording, Sample
from bagpipe.evaluate.window import messages_of, samples

_MOST_FILE_BYTES = 1 << 30


class CaseToJudge:
    """What a user's function gets."""

    def __init__(self, request: dict[str, Any]) -> None:
        self.start: int = request["start"]
        self.end: int = request["end"]
        self.values: dict[str, Any] = request["values"]
        self.result: dict[str, Any] = request["result"]
        path = Path(request["recording"])
        self._recording = Recording(path.read_bytes, self.start, None)
        self._evidence = Evidence(
            self._recording,
            self._recording,
            self.start,
            self.end,
            lead_in_start=request["lead_in_start"],
        )

    @property
    def topics(self) -> list[str]:
        """The topics that something was recorded on."""
        return self._recording.topics

    def messages(self, topic: str) -> list[Sample]:
        """(time in ns, message) of a topic that belong to the case's window; none is an empty
        list. Of what came after the window's end it is what is stamped in it.
        """
        found = messages_of(topic, self._evidence)
        return samples(found, self._evidence) if found.answers else []


def main() -> None:
    """Runs the function once."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (_MOST_FILE_BYTES, _MOST_FILE_BYTES))
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    request = json.load(sys.stdin)
    path = Path(sys.argv[1])
    found = importlib.util.spec_from_file_location("evaluator", path)
    if found is None or found.loader is None:
        sys.exit(f"{path.name} is no Python module")
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    function = getattr(module, request["function"], None)
    if not callable(function):
        sys.exit(f"{path.name} has no function {request['function']}")
    answer = function(CaseToJudge(request))
    if isinstance(answer, bool):
        answer = {"outcome": "passed" if answer else "failed"}
    json.dump(answer, answers)
    answers.close()


if __name__ == "__main__":
    main()
