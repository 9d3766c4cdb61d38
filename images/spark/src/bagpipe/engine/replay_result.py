"""RESULT of a replay: what was delivered, what was recorded, and how it was played."""

from typing import Annotated, Literal, NotRequired

from pydantic import Field, TypeAdapter
from typing_extensions import TypedDict  # pydantic asks for it before Python 3.12

from bagpipe.wire.maps.shape import Elapsed, Natural, Number, default, open_map
from bagpipe.wire.maps.stack import StackEnd

Strength = Literal["sent", "received", "taken", "called"]


@open_map
class LedgerSubscriber(TypedDict):
    """One node's share of a topic."""

    node: Annotated[str, Field(description="The node's name.")]
    received: Annotated[
        Natural,
        Field(description="Messages of the window that came as far as `strength` says."),
    ]
    dropped: Annotated[Natural, Field(description="Messages of the window that did not.")]
    bytes: Annotated[
        Natural,
        Field(description="Bytes of messages of the window that were sent to it."),
    ]
    strength: Annotated[
        Strength,
        Field(
            description="What `received` proves: sent to it, read by its process, taken for the"
            " callback, or the callback has run."
        ),
    ]
    queue: Annotated[
        Natural | None,
        Field(description="Messages that wait in its queue; nil where that can't be known."),
    ]
    waited_seconds: Annotated[
        Elapsed | None,
        Field(
            description="Seconds that its threads could have run, and had no processor, from the"
            " window's start until the messages were received; summed over threads; nil where that"
            " can't be known."
        ),
    ]
    held_up_seconds: NotRequired[
        Annotated[
            Elapsed,
            default(
                0.0, "Seconds that the play waited until it had room, from the window's start on."
            ),
        ]
    ]
    room: NotRequired[
        Annotated[
            Natural | None,
            default(
                None, "The most messages that may wait at it; nil where no queue of its own counts."
            ),
        ]
    ]


@open_map
class LedgerTopic(TypedDict):
    """One published topic."""

    topic: Annotated[str, Field(description="The name that it was published under.")]
    type: Annotated[str, Field(description="The message type's name.")]
    sent: Annotated[
        Natural, Field(description="Messages of the window that were played; 0 if unsubscribed.")
    ]
    lead_in: Annotated[
        Natural, Field(description="Messages before the window that were played; 0 likewise.")
    ]
    subscribers: Annotated[
        list[LedgerSubscriber],
        Field(description="Each node that was connected before the last message was played."),
    ]


@open_map
class Ledger(TypedDict):
    """The proof of delivery."""

    sent: Annotated[Natural, Field(description="Sum of the topics' `sent`.")]
    lead_in: Annotated[Natural, Field(description="Sum of the topics' `lead_in`.")]
    received: Annotated[
        Natural, Field(description="Sum over the topics of what their worst subscriber received.")
    ]
    dropped: Annotated[Natural, Field(description="Sum over all subscribers of all topics.")]
    strength: Annotated[
        Strength | None, Field(description="The weakest of the subscribers'; nil without any.")
    ]
    topics: Annotated[list[LedgerTopic], Field(description="Each published topic.")]


@open_map
class RecordedTopic(TypedDict):
    """One recorded topic."""

    topic: Annotated[str, Field(description="Its name.")]
    type: Annotated[str, Field(description="The message type's name.")]
    messages: Annotated[Natural, Field(description="Messages in the recording.")]


@open_map
class Recorded(TypedDict):
    """What is in the recording."""

    messages: Annotated[Natural, Field(description="Messages in the recording.")]
    bytes: Annotated[Natural, Field(description="Bytes of their data.")]
    high_water_bytes: Annotated[
        Natural, Field(description="The most bytes that the recording held.")
    ]
    topics: Annotated[list[RecordedTopic], Field(description="Each recorded topic.")]


@open_map
class StepReport(TypedDict):
    """What came of the steps with one answer."""

    triggers: Annotated[list[str], Field(description="The inputs that lead to the answer.")]
    answer: Annotated[str, Field(description="The answer's topic.")]
    by: Annotated[Literal["count", "stamp"], Field(description="How an answer was recognised.")]
    released: Annotated[
        Natural,
        Field(description="How often an answer was due: `answered + no_output + skipped`."),
    ]
    answered: Annotated[Natural, Field(description="How often it came in time.")]
    no_output: Annotated[Natural, Field(description="How often it did not.")]
    skipped: Annotated[
        Natural, Field(description="How often it did not, where the input may be skipped.")
    ]
    unmatched: Annotated[
        Natural, Field(description="By stamp: messages on its topic that no input waited for.")
    ]
    waited_seconds: Annotated[
        Elapsed,
        Field(description="Seconds from the inputs to the answer, summed over those that came."),
    ]
    slowest_seconds: Annotated[Elapsed, Field(description="The longest of these times.")]


@open_map
class Playback(TypedDict):
    """How the window was played."""

    asked_rate: Annotated[
        Number, Field(description="Bag seconds per second that were asked for, in realtime.")
    ]
    achieved_rate: Annotated[
        Number,
        Field(
            description="Bag seconds per second, from the window's start to its last message; the"
            " asked rate if that is no time at all."
        ),
    ]
    late_max_seconds: Annotated[
        Elapsed,
        Field(
            description="Seconds that the latest message left after its time; 0 but in realtime."
        ),
    ]
    played_seconds: Annotated[
        Elapsed, Field(description="Seconds that the playing of the window took.")
    ]
    steps: NotRequired[
        Annotated[
            list[StepReport],
            default([], "In lock-step, what came of each answer, the lead-in included."),
        ]
    ]
    warnings: NotRequired[
        Annotated[
            list[str], default([], "Sentences on the way it was played that users should know.")
        ]
    ]
    pace: NotRequired[
        Annotated[
            str | None,
            default(None, "In max, which subscriber set the pace, as a sentence; nil: none did."),
        ]
    ]


@open_map
class ReplayTimings(TypedDict):
    """Seconds of each part of the case; 0 for a part that was not reached."""

    assemble: Annotated[Elapsed, Field(description="Until the recording was there.")]
    master: Annotated[
        Elapsed, Field(description="Until the rosmaster answered; 0 where there is none.")
    ]
    stack: Annotated[Elapsed, Field(description="Until the command was started.")]
    subscribe: Annotated[Elapsed, Field(description="Until the subscribers were there.")]
    lead_in: Annotated[
        Elapsed, Field(description="Latched messages and warm-up, until they were received.")
    ]
    play: Annotated[Elapsed, Field(description="The window.")]
    drain: Annotated[
        Elapsed,
        Field(description="Until the last message was received and the outputs had ended."),
    ]
    stop: Annotated[Elapsed, Field(description="Until no process of the stack was left.")]


@open_map
class Machine(TypedDict):
    """How the machine was during play and drain. What it does not report is nil."""

    late_max_seconds: Annotated[
        Elapsed,
        Field(
            description="Seconds that the latest message left after its time; 0 but in realtime."
        ),
    ]
    stall_max_seconds: Annotated[
        Elapsed,
        Field(description="The most seconds that a thread that wakes every 10 ms woke too late."),
    ]
    cpu_pressure_seconds: Annotated[
        Elapsed | None,
        Field(description="Seconds that some task of the cgroup (else machine) had to wait."),
    ]
    throttled_seconds: Annotated[
        Elapsed | None,
        Field(description="Seconds that its limit kept the cgroup from the processors."),
    ]
    steal_seconds: Annotated[
        Elapsed | None,
        Field(description="Seconds that the hypervisor gave to others, summed over processors."),
    ]
    busy: Annotated[bool, Field(description="Whether it could have caused a loss.")]
    message: Annotated[str, Field(description="Why, or why not, as a sentence.")]


@open_map
class ChosenPlayer(TypedDict):
    """What played the messages."""

    name: Annotated[
        Literal["rcl", "dds"], Field(description="By the image's librcl, or on DDS alone.")
    ]
    why: Annotated[str, Field(description="Why that one, as a sentence's end.")]


@open_map
class ReplayResult(TypedDict):
    """What came of a replay."""

    stack: Annotated[StackEnd, Field(description="How the software under test ended.")]
    ledger: Annotated[Ledger, Field(description="What was delivered.")]
    recorded: Annotated[Recorded, Field(description="What was recorded.")]
    playback: Annotated[Playback, Field(description="How it was played.")]
    timings: Annotated[ReplayTimings, Field(description="Seconds of each part of the case.")]
    machine: NotRequired[
        Annotated[
            Machine,
            Field(description="How the machine was meanwhile; absent where nothing was played."),
        ]
    ]
    player: NotRequired[
        Annotated[ChosenPlayer, Field(description="In ROS 2: what played, and why.")]
    ]


RESULT = TypeAdapter(ReplayResult)
