"""Fields that the type of another ROS does not have: while empty, nothing of them is lost."""

from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys.base import normalize_fieldname


class Unconverted:
    """Those of a set of types, each a field by the name of its type."""

    def __init__(self, types: dict[str, Any]) -> None:
        """Of no field yet, among these types, as rosbags describes them."""
        self._types = types
        self._without_place: dict[str, set[str]] = {}
        self._reaching: dict[str, bool] = {}

    def add(self, name: str, field: str) -> None:
        """A field that has no place in the other type."""
        self._without_place.setdefault(name, set()).add(field)

    def __bool__(self) -> bool:
        return bool(self._without_place)

    def held(self, name: str, message: Any) -> str | None:
        """The first of these fields that is not empty in a message, as Type.field."""
        if not self._reaches(name):
            return None
        for field, kind in self._types[name][1]:
            value = getattr(message, normalize_fieldname(field))
            if field in self._without_place.get(name, ()):
                if not self._is_empty(kind, value):
                    return f"{name}.{field}"
            elif (found := self._held_in(kind, value)) is not None:
                return found
        return None

    def _held_in(self, kind: Any, value: Any) -> str | None:
        node, detail = kind
        if node == Nodetype.NAME:
            return self.held(detail, value)
        if node == Nodetype.BASE or detail[0][0] == Nodetype.BASE:
            return None
        return next((found for each in value if (found := self._held_in(detail[0], each))), None)

    def _reaches(self, name: str) -> bool:
        """Whether a type has such a field, or a field of a type that has one."""
        if name not in self._reaching:
            self._reaching[name] = name in self._without_place or any(
                self._reaches(inner)
                for _, kind in self._types.get(name, ((), ()))[1]
                if (inner := name_in(kind)) is not None
            )
        return self._reaching[name]

    def _is_empty(self, kind: Any, value: Any) -> bool:
        node, detail = kind
        if node == Nodetype.BASE:
            return not value
        if node == Nodetype.SEQUENCE:
            return len(value) == 0
        if node == Nodetype.ARRAY:
            return all(self._is_empty(detail[0], each) for each in value)
        fields = self._types[detail][1]
        return all(
            self._is_empty(each, getattr(value, normalize_fieldname(field)))
            for field, each in fields
        )


def name_in(kind: Any) -> str | None:
    """The type that a field, or an element of it, is a message of."""
    node, detail = kind
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return name_in(detail[0])
    return str(detail) if node == Nodetype.NAME else None
