#!/bin/bash
# The words of code, pages and messages: no typing errors, and none of docs/site/words.txt, which names the
# technical term for each; there a part of a name (snake_case, CamelCase) counts as well. Nor what several
# words say together: docs/site/phrases.txt has a regular expression of each, and what to write.
set -euo pipefail
cd "$(dirname "$0")/.."

# Left out: a frozen release, what programs write, and the lists themselves.
all=(':!tests/e2e/previous' ':!*.lock' ':!*.sum' ':!*.json' ':!*.svg' ':!*.png' ':!LICENSE' ':!docs/site/words.txt' ':!docs/site/phrases.txt')

mapfile -t files < <(git ls-files -- "${all[@]}")
codespell --builtin clear --ignore-words-list effekt,fron,leadin,notin,propert,sourc,wronly "${files[@]}"
codespell --dictionary docs/site/words.txt --regex '[A-Z]?[a-z]+' "${files[@]}"

found=0
while IFS= read -r line; do
  if git grep -n -i -E -e "${line%%->*}" -- "${all[@]}"; then
    echo "write instead: ${line#*->}" >&2
    found=1
  fi
done < docs/site/phrases.txt
exit $found
