"""Questions to an API server and its answers, as deciders have them."""

from dataclasses import dataclass, field
from typing import Any

Json = dict[str, Any]


@dataclass(frozen=True)
class Question:
    """A path of the API server; a `body` is posted to it. With `metadata` no content is read."""

    path: str
    body: Json | None = None
    metadata: bool = False


@dataclass(frozen=True)
class Answer:
    """HTTP's status, 0 where there was no answer; the object, or why not, as the server says."""

    status: int
    body: Json = field(default_factory=dict)
    why: str = ""

    @property
    def there(self) -> bool:
        """Whether it was answered."""
        return 200 <= self.status <= 299

    @property
    def items(self) -> list[Json]:
        """Of a list."""
        found = self.body.get("items")
        listed = found if isinstance(found, list) else []
        return [each for each in listed if isinstance(each, dict)]
