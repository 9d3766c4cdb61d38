"""An upload in parts, to a store that keeps them in memory."""

from collections.abc import Iterator
from typing import Any

import pytest

from bagpipe.storage import Patience, StorageError, upload
from bagpipe.storage.backend import TransientError
from bagpipe.storage.faults import storage_errors
from bagpipe.storage.upload import Upload


class Store:
    """Objects that are complete, as obstore.put makes them, and the parts that came."""

    def __init__(self, fault: OSError | None = None) -> None:
        self.objects: dict[str, bytes] = {}
        self.parts: list[bytes] = []
        self.fault = fault

    def put(self, _store: Any, path: str, data: bytes | Iterator[bytes], **_options: Any) -> None:
        if isinstance(data, bytes):
            self.objects[path] = data
            return
        for part in data:
            if self.fault is not None:
                raise self.fault
            self.parts.append(part)
        self.objects[path] = b"".join(self.parts)


def begun(store: Store, monkeypatch: pytest.MonkeyPatch) -> Upload:
    """An upload in parts of 4 bytes, at most 3 of them."""
    monkeypatch.setattr(upload, "PART_BYTES", 4)
    monkeypatch.setattr(upload, "MOST_PARTS", 3)
    monkeypatch.setattr("obstore.put", store.put)
    unused: Any = None
    return Upload(unused, unused, "a.bin", Patience())


@pytest.mark.parametrize("length", [0, 3, 4, 5, 11, 12])
def test_an_object_of_up_to_the_last_part_is_whole(
    length: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Store()
    sink = begun(store, monkeypatch)
    data = bytes(range(length))
    for at in range(0, length, 5):
        sink.write(data[at : at + 5])
    sink.commit()
    assert store.objects == {"a.bin": data}


@pytest.mark.parametrize("length", [13, 16, 100])
def test_a_part_above_the_last_is_refused_and_nothing_stays(
    length: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = Store()
    sink = begun(store, monkeypatch)

    def write() -> None:
        sink.write(bytes(length))
        sink.commit()

    with pytest.raises(OSError, match=r"at most 12 bytes \(3 parts\): write smaller files"):
        write()
    sink.abandon()
    assert store.objects == {}


@pytest.mark.parametrize("fault", [TransientError("the server answered 503"), OSError("refused")])
def test_what_a_server_did_not_answer_may_pass_and_what_it_refused_may_not(
    fault: OSError, monkeypatch: pytest.MonkeyPatch
) -> None:
    sink = begun(Store(fault), monkeypatch)
    with pytest.raises(StorageError) as failed, storage_errors("s3://b/a.bin", "written"):
        sink.write(bytes(8))
        sink.commit()
    sink.abandon()
    assert failed.value.may_pass is isinstance(fault, TransientError)
