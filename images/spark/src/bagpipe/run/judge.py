"""The verdict on one played case, from the agent's RESULT alone."""

from dataclasses import dataclass
from typing import Any, Literal

Outcome = Literal["passed", "failed", "invalid", "errored"]


class DeliveryIncompleteError(Exception):
    """The ledger shows a loss: what was recorded proves nothing, and the case is run again."""

    def __init__(self, message: str, ledger: dict[str, Any]) -> None:
        super().__init__(message)
        self.ledger = ledger


@dataclass(frozen=True)
class Judgement:
    """A case's outcome and the sentence behind it."""

    outcome: Outcome
    reason: str = ""
    message: str = ""


def judge(result: dict[str, Any]) -> Judgement:
    """Judge a RESULT map. Raises DeliveryIncompleteError where the ledger shows a loss."""
    ledger = result["ledger"]
    for topic in ledger["topics"]:
        _check_delivery(topic, ledger)
    if ledger["sent"] == 0:
        return Judgement(
            "invalid", "NothingPlayed", "the fragment's window holds no message on the topics"
        )
    if result["recorded"]["messages"] == 0:
        return Judgement(
            "invalid", "NothingRecorded", "the stack published nothing on the recorded topics"
        )
    return Judgement("passed")


def _check_delivery(topic: dict[str, Any], ledger: dict[str, Any]) -> None:
    for subscriber in topic["subscribers"]:
        if subscriber["received"] != topic["sent"] or subscriber["dropped"]:
            raise DeliveryIncompleteError(
                f"{subscriber['node']} processed {subscriber['received']} of {topic['sent']}"
                f" messages on {topic['topic']}, {subscriber['dropped']} dropped: its queue is"
                " shorter than its delay; play slower or give the node a longer queue",
                ledger,
            )
