"""Object stores and web servers: `s3://`, `gs://`, `az://`, `https://`, by obstore.

obstore finds credentials where each provider's own tools do: in environment variables, in the
token that a cluster's workload identity projects, or at the cloud's metadata service.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from datetime import timedelta
from typing import TYPE_CHECKING

import obstore
from obstore.store import AzureStore, GCSStore, HTTPStore, S3Store

from bagpipe.storage.backend import ChangedError, Stat, TransientError
from bagpipe.storage.globs import fixed_folder, is_of_one_folder, matcher
from bagpipe.storage.object_faults import asked
from bagpipe.storage.retries import Patience
from bagpipe.storage.upload import Upload

if TYPE_CHECKING:  # names for the type checker alone: obstore has them not at run time
    from obstore import ObjectMeta
    from obstore.store import ClientConfig, ObjectStore, RetryConfig

# Azure allows no hyphen in the names of metadata.
_WRITER = "bagpipewriter"


_CHUNK_BYTES = 64 << 10


class ObjectBackend:
    """One bucket, container or web server."""

    parallel = 8
    gap_bytes = 256 << 10

    def __init__(self, scheme: str, authority: str, patience: Patience) -> None:
        self._writable = scheme not in {"http", "https"}
        self._patience = patience
        with asked():
            # Our own retries know the byte where an answer broke off.
            self._store = _store(scheme, authority, patience, retries=0)
            # Parts of an upload are sent again by the library, which holds them.
            self._uploads = _store(scheme, authority, patience, retries=patience.tries - 1)

    def stat(self, path: str) -> Stat:
        """Size and version of an object; FileNotFoundError where there is none."""
        with asked():
            return _stat(obstore.head(self._store, path))

    def read(self, path: str, offset: int, length: int, version: str) -> bytes:
        """Bytes from `offset`, fewer where the answer broke off."""
        with asked():
            answer = obstore.get(self._store, path, options={"range": (offset, offset + length)})
            if _stat(answer.meta).version != version:
                raise ChangedError
            data = bytearray()
            try:
                # What the stream holds back when it breaks is lost: at most one chunk.
                for chunk in answer.stream(min_chunk_size=_CHUNK_BYTES):
                    data += memoryview(chunk)
            except Exception:
                # What came is kept; only an answer without a byte raises.
                if not data:
                    raise
            return bytes(data)

    def glob(self, pattern: str) -> list[str]:
        """The objects that a pattern matches, below the folder before its first wildcard."""
        self._refuse_listing()
        matches, folder = matcher(pattern), fixed_folder(pattern)
        # The folders in it may hold millions of objects.
        paths = self._in(folder) if is_of_one_folder(pattern) else self._below(folder)
        return [path for path in paths if matches(path)]

    def names(self, folder: str) -> list[str]:
        """The names in a folder, also of folders in it; empty where it does not exist."""
        self._refuse_listing()
        paths = self._in(folder, with_folders=True)
        return [path.rstrip("/").rpartition("/")[2] for path in paths]

    def remove(self, path: str) -> None:
        """Remove an object that may be gone already."""
        self._refuse_writing()
        with asked(), contextlib.suppress(FileNotFoundError):
            obstore.delete(self._store, path)

    def create(self, path: str) -> Upload:
        """Begin an object: it has no name, nor a folder, until its upload is complete."""
        self._refuse_writing()
        return Upload(self._store, self._uploads, path, self._patience)

    def put_once(self, path: str, data: bytes, writer: str) -> bool:
        """Create a whole object by a conditional put (`If-None-Match: *`)."""
        self._refuse_writing()
        with asked():
            try:
                attributes = {_WRITER: writer}
                obstore.put(
                    self._store,
                    path,
                    data,
                    mode="create",
                    use_multipart=False,
                    attributes=attributes,
                )
            except obstore.exceptions.AlreadyExistsError:
                return self._is_of(path, data, writer)
        return True

    def _is_of(self, path: str, data: bytes, writer: str) -> bool:
        """Whether the object under a name that is taken is the one that this writer put.

        Where a server keeps no metadata the content decides, which in a manifest names its driver.
        """
        try:
            found = obstore.get(self._store, path)
        except FileNotFoundError:
            raise TransientError("the name was taken a moment ago, and has no object now") from None
        if (named := found.attributes.get(_WRITER)) is not None:
            return bool(named == writer)
        return found.meta["size"] == len(data) and bytes(found.bytes()) == data

    def _in(self, folder: str, with_folders: bool = False) -> list[str]:
        with asked():
            try:
                found = obstore.list_with_delimiter(self._store, folder or None)
            except FileNotFoundError:
                return []
        folders = found["common_prefixes"] if with_folders else []
        return [*folders, *(entry["path"] for entry in found["objects"])]

    def _below(self, folder: str) -> Iterator[str]:
        with asked():
            for entries in obstore.list(self._store, folder or None):
                for entry in entries:
                    yield entry["path"]

    def _refuse_writing(self) -> None:
        if not self._writable:
            raise OSError("a web server can only be read from: name another storage as output")

    def _refuse_listing(self) -> None:
        if not self._writable:
            raise OSError("a web server has no list of its files: name each bag without wildcards")


def _stat(meta: ObjectMeta) -> Stat:
    """The version is the server's ETag, or without one the time of the last change."""
    mark = meta["e_tag"] or meta["last_modified"].isoformat()
    return Stat(meta["size"], f"{meta['size']}-{mark}")


def _store(scheme: str, authority: str, patience: Patience, retries: int) -> ObjectStore:
    client: ClientConfig = {
        "timeout": timedelta(seconds=patience.request_seconds),
        "connect_timeout": timedelta(seconds=min(5.0, patience.request_seconds)),
        "user_agent": "bagpipe",
        # A server inside the cluster often has no certificate; its URL says which it is.
        "allow_http": scheme == "http" or _endpoint().startswith("http://"),
    }
    retry: RetryConfig = {
        "max_retries": retries,
        "retry_timeout": timedelta(seconds=patience.request_seconds * patience.tries),
        "backoff": {
            "init_backoff": timedelta(seconds=patience.first_pause_seconds),
            "max_backoff": timedelta(seconds=patience.longest_pause_seconds),
            "base": 2,
        },
    }
    if scheme == "s3":
        return S3Store(authority, client_options=client, retry_config=retry)
    if scheme == "gs":
        return GCSStore(authority, client_options=client, retry_config=retry)
    if scheme == "az":
        return AzureStore(authority, client_options=client, retry_config=retry)
    return HTTPStore(f"{scheme}://{authority}", client_options=client, retry_config=retry)


def _endpoint() -> str:
    names = ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AZURE_STORAGE_ENDPOINT")
    return next((os.environ[name] for name in names if name in os.environ), "")
