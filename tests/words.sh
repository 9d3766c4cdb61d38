#!/bin/bash
# The words of code, pages and messages: no typing errors, and none of docs/site/words.txt, which names the
# technical term for each; there a part of a name (snake_case, CamelCase) counts as well.
set -euo pipefail
cd "$(dirname "$0")/.."

# Left out: a frozen release, what programs write, and the list itself.
all=(':!tests/e2e/previous' ':!*.lock' ':!*.sum' ':!*.json' ':!*.svg' ':!*.png' ':!LICENSE' ':!docs/site/words.txt')
# Still to be rewritten (docs/limits.md, "The code's own walls").
# Made by the agent, or made from it.
left=(':!images/agent' ':!docs/reference/agent.md' ':!docs/reference/metrics.md')

mapfile -t files < <(git ls-files -- "${all[@]}")
codespell --builtin clear --ignore-words-list effekt,fron,leadin,notin,propert,sourc,wronly "${files[@]}"
mapfile -t files < <(git ls-files -- "${all[@]}" "${left[@]}")
codespell --dictionary docs/site/words.txt --regex '[A-Z]?[a-z]+' "${files[@]}"
