"""Sphinx's settings: the Markdown below docs/ as it is, and nothing that needs a network.

`make docs` builds the site into build/docs; docs/site/build.py says how.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

project = "Bagpipe"
author = "The Bagpipe authors"
extensions = ["myst_parser", "docs.site.extension"]
source_suffix = {".md": "markdown"}
root_doc = "README"
exclude_patterns = ["site"]
# The anchors of all headings, as forges make them.
myst_heading_anchors = 6
# A block that says no language is shown as it is.
highlight_language = "text"

html_theme = "furo"
html_title = "Bagpipe"
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
html_use_index = False
html_domain_indices = False
# A result's first words would be fetched from its page, which browsers refuse to pages on a disk.
html_show_search_summary = False
