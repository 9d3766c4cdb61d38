"""`source.catalogue`: a table of recordings, and which of them a job is about."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, Field

from bagpipe.pod_spec import SPEC_CONFIG
from bagpipe.source_fields import SourceFields
from bagpipe.texts import BagUri, each_once


def _table(uri: str) -> str:
    if not uri.endswith((".csv", ".parquet")) or any(letter in uri for letter in "*?["):
        raise ValueError(f"{uri!r} is no catalogue: write the URI of one .csv or .parquet file")
    return uri


def _place(uri: str) -> str:
    if any(letter in uri for letter in "*?["):
        raise ValueError(
            f"{uri!r} has a wildcard: write a folder, such as pvc://recordings/drives/"
        )
    return uri


class Catalogue(BaseModel):
    """One file, an expression in CEL over its columns, and where its recordings may be."""

    model_config = SPEC_CONFIG

    uri: Annotated[BagUri, AfterValidator(_table), Field(max_length=1024)]
    where: str = Field(min_length=1, max_length=2048, pattern=r"\S")
    within: Annotated[
        list[Annotated[BagUri, AfterValidator(_place)]], AfterValidator(each_once)
    ] = Field(default=[], max_length=16)


def _uris(catalogue: Catalogue) -> list[str]:
    """What may be read, and no more: volumes and rights follow from it, whatever the rows name."""
    return [catalogue.uri, *catalogue.within]


FIELDS = SourceFields(type=Catalogue | None, default=None, uris=_uris, taken_as="bags", place=4)
