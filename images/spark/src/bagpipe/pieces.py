"""Pieces of recordings, as a spec writes them: put one after the other, or beside a simulator.

Their texts may hold templates, which each case fills in with its values.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Self, TypeVar

from pydantic import AfterValidator, BaseModel, Field, JsonValue, ValidationError, model_validator

from bagpipe.matrix.faults import MatrixError
from bagpipe.matrix.templates import filled_text, has_template
from bagpipe.pod_spec import SPEC_CONFIG
from bagpipe.texts import BagUri, Name, duration_nanoseconds, each_once


def _one_bag(uri: str) -> str:
    if re.search(r"[*?\[]", uri):
        raise ValueError(f"{uri!r} has a wildcard, and a piece is of one bag: write its name")
    return uri


def _offset(text: str) -> str:
    if not has_template(text):
        duration_nanoseconds(text)
    return text


PieceUri = Annotated[BagUri, AfterValidator(_one_bag)]
Offset = Annotated[str, AfterValidator(_offset)]
P = TypeVar("P", bound="Piece")


class Piece(BaseModel):
    """One recording from an offset on, which counts from its first message."""

    model_config = SPEC_CONFIG

    bag: PieceUri
    from_: Offset = Field(default="0s", alias="from")

    @property
    def from_nanoseconds(self) -> int:
        """Of a piece without templates."""
        return duration_nanoseconds(self.from_)


class SequencePart(Piece):
    """`source.sequence[]`: a piece that is played `pause` after the one before it is over."""

    to: Offset | None = None
    pause: Offset = "0s"
    times: int = Field(default=1, ge=1, le=100)

    @model_validator(mode="after")
    def _ends_behind_its_start(self) -> Self:
        if self.to is None or has_template([self.from_, self.to]):
            return self
        if duration_nanoseconds(self.to) <= self.from_nanoseconds:
            raise ValueError(f"the piece ends at {self.to}, not behind its start at {self.from_}")
        return self


class RecordedTopics(Piece):
    """`source.simulator.recorded[]`: recorded topics that are played during a simulated drive."""

    topics: Annotated[list[Name], AfterValidator(each_once)] = Field(min_length=1, max_length=100)


def bags_of(pieces: Sequence[Piece]) -> list[str]:
    """The URIs of the pieces' bags, each once."""
    return list(dict.fromkeys(piece.bag for piece in pieces))


def filled_pieces(pieces: list[P], known: Mapping[str, JsonValue], where: str) -> list[P]:
    """The pieces with a case's values in them. Raises MatrixError; `where` is the spec's field."""
    return [_filled(piece, known, f"{where}[{number}]") for number, piece in enumerate(pieces)]


def _filled(piece: P, known: Mapping[str, JsonValue], where: str) -> P:
    written = {
        name: filled_text(value, known, f"{where}.{name}") if isinstance(value, str) else value
        for name, value in piece.model_dump(by_alias=True).items()
    }
    try:
        return type(piece).model_validate(written)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join([where, *map(str, first["loc"])])
        values = ", ".join(f"{name} = {value}" for name, value in known.items())
        raise MatrixError(f"{place}: {first['msg']} (with {values})") from error
