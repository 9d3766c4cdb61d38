"""A message definition as Spark's and Arrow's types, and messages as values of them.

An unsigned integer takes the next larger signed type. `uint8[]`, `char[]` and `byte[]` are
binary. `time` and `duration` are integers of ns, because Spark's timestamps end at microseconds.
"""

from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

import pyarrow as pa
from pyspark.sql import types
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from bagpipe.definitions import full_name, types_in
from bagpipe.encodings import CDR
from bagpipe.rosbag_source.planning import TopicType

Convert = Callable[[Any], Any]


@dataclass(frozen=True)
class Column:
    """One type in both worlds, and how a decoded value becomes Arrow's."""

    spark: types.DataType
    arrow: pa.DataType
    convert: Convert


def _same(value: Any) -> Any:
    return value


def _listed(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value


_SCALARS = {
    "bool": Column(types.BooleanType(), pa.bool_(), bool),
    "int8": Column(types.ByteType(), pa.int8(), int),
    "byte": Column(types.ByteType(), pa.int8(), int),
    "uint8": Column(types.ShortType(), pa.int16(), int),
    "char": Column(types.ShortType(), pa.int16(), int),
    "int16": Column(types.ShortType(), pa.int16(), int),
    "uint16": Column(types.IntegerType(), pa.int32(), int),
    "int32": Column(types.IntegerType(), pa.int32(), int),
    "uint32": Column(types.LongType(), pa.int64(), int),
    "int64": Column(types.LongType(), pa.int64(), int),
    "uint64": Column(types.DecimalType(20, 0), pa.decimal128(20, 0), Decimal),
    "float32": Column(types.FloatType(), pa.float32(), float),
    "float64": Column(types.DoubleType(), pa.float64(), float),
    "string": Column(types.StringType(), pa.string(), str),
}
_OCTETS = {"uint8", "char", "byte", "int8"}
_TIMES = {"builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"}


class Decoder:
    """Turns one topic's bytes into rows, by the definition that the bag itself carries."""

    def __init__(self, kind: TopicType) -> None:
        self._type = full_name(kind.type)
        self._cdr = kind.encoding == CDR
        self._store: Typestore = get_typestore(Stores.EMPTY)
        self._store.register(types_in(kind.type, kind.definition, kind.schema_encoding))
        self.column = self._named(self._type)

    def decode(self, data: bytes) -> Any:
        """A message's value, as its column's Arrow type takes it."""
        if self._cdr:
            return self.column.convert(self._store.deserialize_cdr(data, self._type))
        return self.column.convert(self._store.deserialize_ros1(data, self._type))

    def _named(self, name: str) -> Column:
        if name in _TIMES:
            return Column(types.LongType(), pa.int64(), _nanoseconds)
        fields = [(field, self._described(kind)) for field, kind in self._store.fielddefs[name][1]]

        def convert(message: Any) -> dict[str, Any]:
            return {field: column.convert(getattr(message, field)) for field, column in fields}

        return Column(
            types.StructType([types.StructField(f, column.spark) for f, column in fields]),
            pa.struct([(f, column.arrow) for f, column in fields]),
            convert,
        )

    def _described(self, description: Any) -> Column:
        kind, detail = description
        if kind == Nodetype.BASE:
            return _SCALARS[detail[0]]
        if kind == Nodetype.NAME:
            return self._named(detail)
        (inner_kind, inner_detail), _length = detail
        if inner_kind == Nodetype.BASE and inner_detail[0] in _OCTETS:
            return Column(types.BinaryType(), pa.binary(), bytes)
        inner = self._described((inner_kind, inner_detail))
        spark, arrow = types.ArrayType(inner.spark), pa.list_(pa.field("element", inner.arrow))
        if inner_kind == Nodetype.BASE and inner_detail[0] != "uint64":
            return Column(spark, arrow, _listed)
        convert = inner.convert
        return Column(spark, arrow, lambda values: [convert(value) for value in values])


def _nanoseconds(time: Any) -> int:
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)
