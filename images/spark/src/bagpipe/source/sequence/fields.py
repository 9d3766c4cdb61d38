"""`source.sequence`: pieces of bags."""

from typing import Annotated

from pydantic import Field

from bagpipe.pieces import SequencePart, bags_of
from bagpipe.source_fields import SourceFields

FIELDS = SourceFields(
    type=Annotated[list[SequencePart], Field(max_length=100)], default=[], uris=bags_of, place=1
)
