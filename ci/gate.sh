#!/bin/bash
# A gate of a pipeline: run a job here or in the cluster, keep its results as a CI shows them, compare
# them, post a comment, and end with the verdict. docs/tasks/ci-gate.md has the table of ends.
#
#   BAGPIPE_JOB        the manifest; @IMAGE@ in it stands for BAGPIPE_IMAGE
#   BAGPIPE_IMAGE      the image under test
#   BAGPIPE_MODE       submit (to the cluster, by default) or run (on this machine)
#   BAGPIPE_NAMESPACE  the job's namespace, for submit
#   BAGPIPE_TIMEOUT    how long the job is waited for, 30m by default, for submit
#   BAGPIPE_BASELINE   results to compare with: job/NAME, a URI or a folder; none by default
#   BAGPIPE_VOLUMES    lines CLAIM=FOLDER: folders that stand for claims
#   BAGPIPE_ARTIFACTS  the folder of what is kept, bagpipe-ci by default
#   BAGPIPE_COMMENT    words of a command that takes a Markdown file as its last, such as
#                      "gh pr comment 812 --body-file"; none by default
set -uo pipefail

# GitHub takes 65,536 characters; the results and the comparison get a part each.
readonly PART=28000

refuse() {
  echo "gate: $1" >&2
  exit 2
}

# Indented lines are code, whatever is in them: case names and messages are a stack's own words.
quoted() {
  local text
  text=$(sed 's/^/    /')
  printf '%s\n' "${text:0:PART}"
  [ "${#text}" -le "$PART" ] || printf '\nThe rest is in %s.\n' "$1"
}

comment() {
  printf '## Bagpipe: %s\n\n' "$verdict"
  if [ -s "$folder/results.txt" ]; then
    quoted results.txt <"$folder/results.txt"
  else
    tail -n 100 "$folder/program.txt" | quoted program.txt
  fi
  if [ -n "${BAGPIPE_BASELINE:-}" ]; then
    printf '\nCompared with the baseline:\n\n'
    quoted comparison.txt <"$folder/comparison.txt"
  fi
}

folder=${BAGPIPE_ARTIFACTS:-bagpipe-ci}
mode=${BAGPIPE_MODE:-submit}
[ -n "${BAGPIPE_JOB:-}" ] || refuse "BAGPIPE_JOB names no manifest"
[ -f "$BAGPIPE_JOB" ] || refuse "there is no manifest $BAGPIPE_JOB"
case ${BAGPIPE_IMAGE:-} in
*[!A-Za-z0-9._:/@-]*) refuse "BAGPIPE_IMAGE is no image's name: ${BAGPIPE_IMAGE@Q}" ;;
esac
# Else another image would be tested than the one that the gate is for.
if sed -E 's/(^|[[:space:]])#.*//' "$BAGPIPE_JOB" | grep -qF '@IMAGE@'; then
  [ -n "${BAGPIPE_IMAGE:-}" ] || refuse "$BAGPIPE_JOB has @IMAGE@, and BAGPIPE_IMAGE names no image for it"
elif [ -n "${BAGPIPE_IMAGE:-}" ]; then
  refuse "$BAGPIPE_JOB has no @IMAGE@ that $BAGPIPE_IMAGE could stand for: write it as the image under test"
fi
mkdir -p "$folder" || refuse "$folder can't be made"
rm -f "$folder"/{state.json,junit.xml,results.txt,report.html,comparison.txt,comment.md,program.txt}

place=()
while IFS= read -r volume; do
  [ -z "$volume" ] || place+=(--volume "$volume")
done <<<"${BAGPIPE_VOLUMES:-}"
sed "s|@IMAGE@|${BAGPIPE_IMAGE:-}|g" "$BAGPIPE_JOB" >"$folder/job.yaml"

case $mode in
submit)
  at=(${BAGPIPE_NAMESPACE:+-n "$BAGPIPE_NAMESPACE"})
  bagpipe submit "$folder/job.yaml" "${at[@]}" --generate-name --wait --output json \
    --timeout "${BAGPIPE_TIMEOUT:-30m}" 2>&1 >"$folder/state.json" | tee "$folder/program.txt" >&2
  status=${PIPESTATUS[0]}
  results=$(python3 -c 'import json, sys; print(json.load(open(sys.argv[1]))["name"])' \
    "$folder/state.json" 2>/dev/null) || results=
  # A name alone is a job's after -n; without one it has to say so.
  [ -z "$results" ] || results=job/$results
  place+=("${at[@]}")
  ;;
run)
  results=$folder/results
  bagpipe run "$folder/job.yaml" "${place[@]}" --results "$results" --replace --output json \
    2>&1 >"$folder/state.json" | tee "$folder/program.txt" >&2
  status=${PIPESTATUS[0]}
  ;;
*) refuse "BAGPIPE_MODE is $mode; it can be submit or run" ;;
esac

if [ -s "$folder/state.json" ]; then
  bagpipe results "$results" "${place[@]}" --junit "$folder/junit.xml" >"$folder/results.txt"
  bagpipe report "$results" "${place[@]}" --to "$folder/report.html"
fi
compared=0
if [ -n "${BAGPIPE_BASELINE:-}" ]; then
  compared=2
  : >"$folder/comparison.txt"
  if [ -s "$folder/results.txt" ]; then
    bagpipe compare "$BAGPIPE_BASELINE" "$results" "${place[@]}" >"$folder/comparison.txt" 2>&1
    compared=$?
  fi
fi
# What could not be run weighs more than what was worse.
[ "$compared" -le "$status" ] || status=$compared
case $status in
0) verdict=Passed ;;
1) verdict="not passed" ;;
*) verdict="no verdict" ;;
esac
comment >"$folder/comment.md"
if [ -n "${BAGPIPE_COMMENT:-}" ]; then
  read -r -a poster <<<"$BAGPIPE_COMMENT"
  # A comment that can't be posted takes nothing from the verdict.
  "${poster[@]}" "$folder/comment.md" || echo "gate: the comment was not posted ($BAGPIPE_COMMENT)" >&2
fi
exit "$status"
