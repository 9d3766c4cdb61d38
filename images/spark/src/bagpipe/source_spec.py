"""`spec.source`: what all sources have in common, and the model with the keys of those installed.

The model is made when a spec is first read: what is installed may be broken.
"""

import functools
import re
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    GetCoreSchemaHandler,
    create_model,
    model_validator,
)
from pydantic_core import CoreSchema

from bagpipe.installed import InstallationError, meaningless_in
from bagpipe.pod_spec import SPEC_CONFIG
from bagpipe.source_fields import one_source_sentence, source_fields, source_names
from bagpipe.texts import Duration, Name, PositiveDuration, each_once


class _Model(BaseModel):
    model_config = SPEC_CONFIG


class Fragment(_Model):
    """How a bag is cut: windows of about `length`, each led in by `warm_up` that does not count."""

    length: PositiveDuration = "60s"
    warm_up: Duration = "0s"


class Source(_Model):
    """What all sources have in common: that a job has one of them, and what selects from bags."""

    topics: Annotated[list[Name], AfterValidator(each_once)] = []
    fragment: Fragment = Fragment()

    @property
    def kind(self) -> str:
        """Which one of them is written."""
        return next(name for name in source_names() if getattr(self, name))

    @property
    def own(self) -> Any:
        """What is written below its key, as its folder declares it."""
        return getattr(self, self.kind)

    @property
    def uris(self) -> list[str]:
        """The bags or the files, or what the pieces are of, whose names may hold templates."""
        return source_fields(self.kind).uris(self.own)

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if [bool(getattr(self, name)) for name in source_names()].count(True) != 1:
            raise ValueError(one_source_sentence())
        refused = meaningless_in(self, source_fields(self.kind).meaningless)
        if refused is not None:
            raise ValueError(refused)
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Each process makes the model itself: pickle could not name the class."""
        return _unpickled, (self.__getstate__(),)


@functools.cache
def source_model() -> type[Source]:
    """`Source` with a key for each source, in their order. Raises InstallationError."""
    # The fields of the last base are the first of the model.
    bases: Any = (Source, *reversed([_key(name) for name in source_names()]))
    model: type[Source] = create_model("Source", __base__=bases, __module__=__name__)
    return model


class _WithKeys:
    """Has pydantic take the model with all keys where `Source` is written."""

    def __get_pydantic_core_schema__(
        self, _source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return handler.generate_schema(source_model())


InstalledSource = Annotated[Source, _WithKeys()]


def _key(name: str) -> type[BaseModel]:
    if not re.fullmatch(r"[a-z]+", name) or name in Source.model_fields or hasattr(Source, name):
        raise InstallationError(
            f"the source {name!r} can't be a key of spec.source: rename its folder to one word of"
            " small letters that spec.source does not have"
        )
    fields = source_fields(name)
    key: Any = {name: (fields.type, fields.default)}
    try:
        return create_model("Key", __base__=_Model, **key)
    except Exception as error:  # an added source's type may be anything
        why = str(error).partition("\n")[0]
        raise InstallationError(
            f"the type that the source {name!r} declares is none for pydantic ({why}): correct the"
            " source, or remove its folder"
        ) from error


def _unpickled(state: Any) -> Source:
    model = source_model()
    made = model.__new__(model)
    made.__setstate__(state)
    return made
