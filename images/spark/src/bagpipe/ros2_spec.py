"""What a spec says of ROS 2 alone: what plays, its quality of service, and its parameters' form."""

import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, Field, JsonValue, model_validator

from bagpipe.pod_spec import SPEC_CONFIG
from bagpipe.texts import Name, NodeName, each_once

# The node's full name, whose parts may be wildcards, and the parameter's behind the last slash.
_PARAMETER = re.compile(r"(?:/(?:[A-Za-z_][A-Za-z0-9_]*|\*\*?))+/[^/]+")


# By the image's librcl, on DDS alone, or as it can be.
Player = Literal["auto", "rcl", "dds"]


class Qos(BaseModel):
    """What is offered for one played topic; what is None is offered as it was recorded."""

    model_config = SPEC_CONFIG

    reliability: Literal["reliable", "bestEffort"] | None = None
    durability: Literal["volatile", "transientLocal"] | None = None
    depth: int | None = Field(default=None, ge=1, le=100_000)


class Ros2(BaseModel):
    """`stack.ros2`: the topics of `qos` have their names in the recording."""

    model_config = SPEC_CONFIG

    player: Player = "auto"

    qos: dict[Name, Qos] = Field(default={}, max_length=200)

    active: Annotated[list[NodeName], AfterValidator(each_once)] = Field(default=[], max_length=64)

    flow_control: bool = True

    @model_validator(mode="after")
    def _states_are_asked_for_by_librcl(self) -> Self:
        if self.active and self.player == "dds":
            raise ValueError(
                "stack.ros2.active has no meaning with stack.ros2.player: dds, which can't ask"
                " nodes for their states: write player: rcl, or name nodes in playback.waitFor"
            )
        return self


def parameters_refusal(parameters: Mapping[str, JsonValue]) -> str | None:
    """Why no node of ROS 2 could have these parameters; None where one could.

    A name is that of a node, where `**` is any, with the parameter's behind it.
    """
    for name, value in parameters.items():
        if not _PARAMETER.fullmatch(name):
            return (
                f"stack.parameters has {name}, which names no node, and ROS 2 has no parameters but"
                " those of nodes: write /node/parameter, or /**/parameter for all nodes"
            )
        if not _is_a_value(value):
            return (
                f"stack.parameters[{name}] is nothing that a parameter of ROS 2 can be: write a"
                " truth value, a number, a text, a list of such of one kind, or a map to these"
            )
    return None


def _is_a_value(value: JsonValue) -> bool:
    if isinstance(value, dict):
        return all(_is_a_value(each) for each in value.values())
    if isinstance(value, list):
        # A template may become anything.
        kinds = set(_kinds(value))
        return None not in kinds and len(kinds) < 2
    return value is not None


def _kinds(values: list[JsonValue]) -> Iterator[type | None]:
    """The kinds of a list's elements but templates; None of what can't be in one."""
    for value in values:
        if value is None or isinstance(value, list | dict):
            yield None
        elif not (isinstance(value, str) and "{{" in value):
            yield type(value)
