"""The operator, which ends as by kill -9 at one write: before it is sent, or once it is answered.

Run in the place of `bagpipe-operator`. BAGPIPE_TEST_DIES is "before" or "after", a space, and a
regular expression for the write: its method, its path and its body as JSON, with a space between.
"""

import json
import os
import re
import signal
import sys
from pathlib import Path

from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.client import KubernetesApi
from bagpipe_operator.main import main

PROGRAM = [sys.executable, str(Path(__file__))]
DIES = "BAGPIPE_TEST_DIES"

_answer = KubernetesApi._answer


async def _dying(
    self: KubernetesApi, method: str, path: str, body: Json | None, headers: dict[str, str]
) -> Json:
    when, _, pattern = os.environ.get(DIES, "").partition(" ")
    meant = bool(pattern) and re.search(pattern, f"{method} {path} {json.dumps(body)}") is not None
    if meant and when == "before":
        os.kill(os.getpid(), signal.SIGKILL)
    answer = await _answer(self, method, path, body, headers)
    if meant:
        os.kill(os.getpid(), signal.SIGKILL)
    return answer


if __name__ == "__main__":
    KubernetesApi._answer = _dying  # type: ignore[method-assign]
    main()
