"""Values of a scenario in a stack's texts: `{{ name }}`, and nothing more than a name.

A text that is one template alone takes the value with its type, so that a ROS parameter stays a
number; within other text the value is written as JSON would write it, strings without quotes.
"""

import json
import re
from collections.abc import Mapping

from pydantic import JsonValue

from bagpipe.matrix.faults import MatrixError

# Blanks are stripped from the name afterwards: with them in the pattern, `{{` and a thousand blanks
# keep whoever looks for a template, the operator among them, for seconds, and 20,000 for hours.
_TEMPLATE = re.compile(r"\{\{([^{}]*)\}\}")


def has_template(value: JsonValue) -> bool:
    """Whether there is a template anywhere in it."""
    return _TEMPLATE.search(json.dumps(value)) is not None


def filled(value: JsonValue, known: Mapping[str, JsonValue], where: str) -> JsonValue:
    """The value with every template in it replaced, in lists and maps too.

    Raises MatrixError; `where` names the field in its message.
    """
    if isinstance(value, str):
        return _filled_text(value, known, where)
    if isinstance(value, list):
        return [filled(item, known, where) for item in value]
    if isinstance(value, dict):
        return {key: filled(item, known, f"{where}.{key}") for key, item in value.items()}
    return value


def filled_text(text: str, known: Mapping[str, JsonValue], where: str) -> str:
    """The text with every template in it replaced, and always a text. Raises MatrixError."""
    return _TEMPLATE.sub(lambda found: _written(_known(found[1].strip(), known, where)), text)


def _filled_text(text: str, known: Mapping[str, JsonValue], where: str) -> JsonValue:
    alone = _TEMPLATE.fullmatch(text.strip())
    if alone:
        return _known(alone[1].strip(), known, where)
    return filled_text(text, known, where)


def _known(name: str, known: Mapping[str, JsonValue], where: str) -> JsonValue:
    if name not in known:
        raise MatrixError(
            f"{where} names {{{{ {name} }}}}, which is no variable:"
            f" it can be {', '.join(sorted(known))}"
        )
    return known[name]


def _written(value: JsonValue) -> str:
    return value if isinstance(value, str) else json.dumps(value)
