"""spark.read.format("rosbag") on the real PR2 recording, beside what the rosbags library says."""

from pathlib import Path
from typing import Any, cast

import pytest
from pyspark.errors import PySparkException
from pyspark.sql import DataFrame, SparkSession
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore

import bagpipe
from bagpipe.topic_names import resolve
from tests.recording import MESSAGES, fetch

STORE = get_typestore(Stores.ROS1_NOETIC)


def read(spark: SparkSession, path: Path, **options: str | int) -> DataFrame:
    spark.dataSource.register(bagpipe.RosbagDataSource)
    return spark.read.format("rosbag").options(**options).load(f"file://{path}")


def test_all_messages_are_rows_whose_bytes_are_the_recordings(spark: SparkSession) -> None:
    frame = read(spark, fetch(), fragment=4)
    assert frame.columns == ["topic", "time_ns", "type", "md5sum", "data"]
    assert frame.rdd.getNumPartitions() == 4
    rows = frame.collect()
    assert len(rows) == MESSAGES
    with Reader(fetch()) as reader:
        expected = [(resolve(c.topic), time, bytes(data)) for c, time, data in reader.messages()]
    assert sorted((r.topic, r.time_ns, bytes(r.data)) for r in rows) == sorted(expected)


def test_decoded_messages_are_typed_columns(spark: SparkSession) -> None:
    frame = read(spark, fetch(), topics="/joint_states", decode="true", fragment=8)
    found = frame.selectExpr(
        "time_ns", "message.name[3] as joint", "message.position[3] as position"
    ).collect()
    with Reader(fetch()) as reader:
        expected = sorted(
            (time, message.name[3], message.position[3])
            for c, time, data in reader.messages()
            for message in [cast("Any", STORE.deserialize_ros1(data, c.msgtype))]
        )
    assert sorted(tuple(row) for row in found) == expected
    assert dict(frame.select("message.*").dtypes)["effort"] == "array<double>"


def test_a_bag_that_is_none_is_refused_by_name(spark: SparkSession, tmp_path: Path) -> None:
    (tmp_path / "no.bag").write_bytes(b"#ROSBAG V1.2\n" + bytes(5000))
    with pytest.raises(PySparkException, match=r"no\.bag"):
        read(spark, tmp_path / "no.bag").count()
