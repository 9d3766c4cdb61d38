"""`source.bags`: the URIs of bags."""

from bagpipe.source_fields import SourceFields
from bagpipe.texts import BagUri

FIELDS = SourceFields(type=list[BagUri], default=[], uris=list, place=0)
