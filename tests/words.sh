#!/bin/bash
# The words of code, pages and messages: no typing errors, and none of docs/site/words.txt, which names the
# technical term for each; there a part of a name (snake_case, CamelCase) counts as well.
set -euo pipefail
cd "$(dirname "$0")/.."

# Left out: a frozen release, what programs write, and the list itself.
all=(':!tests/e2e/previous' ':!*.lock' ':!*.sum' ':!*.json' ':!*.svg' ':!*.png' ':!LICENSE' ':!docs/site/words.txt')

mapfile -t files < <(git ls-files -- "${all[@]}")
codespell --builtin clear --ignore-words-list effekt,fron,leadin,notin,propert,sourc,wronly "${files[@]}"
codespell --dictionary docs/site/words.txt --regex '[A-Z]?[a-z]+' "${files[@]}"
