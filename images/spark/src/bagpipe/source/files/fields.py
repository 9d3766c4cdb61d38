"""`source.files`: the URIs of files of any kind."""

from bagpipe.source_fields import SourceFields
from bagpipe.texts import BagUri

FIELDS = SourceFields(
    type=list[BagUri],
    default=[],
    uris=list,
    bags=False,
    meaningless={("topics",): "source.topics select from bags: leave them out with source.files"},
    place=2,
)
