"""Builds the site: `python -m docs.site.build FOLDER`; whatever Sphinx warns of is an error."""

import sys
from pathlib import Path

from sphinx.cmd.build import build_main

DOCS = Path(__file__).resolve().parents[1]


def main() -> int:
    """0 when the site is in FOLDER without a warning."""
    if len(sys.argv) != 2:
        print("usage: python -m docs.site.build FOLDER", file=sys.stderr)
        return 2
    target = Path(sys.argv[1])
    own = ["-c", str(DOCS / "site"), "-d", str(target.with_name(f"{target.name}.doctrees"))]
    strict = ["--fail-on-warning", "--keep-going", "--quiet"]
    return build_main(["-b", "html", *strict, *own, str(DOCS), str(target)])


if __name__ == "__main__":
    sys.exit(main())
