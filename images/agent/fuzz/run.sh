#!/bin/bash
# run.sh SECONDS [TARGET...]: fuzzes each target for so long under the address sanitizer, from
# seeds that our own code writes, and says how many inputs it took. Fails if one input failed.
set -euo pipefail
cd "$(dirname "$0")"
seconds=$1
shift
if ! rustc +nightly --version > /dev/null 2>&1; then
  echo "libFuzzer needs nightly Rust: rustup toolchain install nightly --profile minimal" >&2
  exit 1
fi
if ! cargo fuzz --version > /dev/null 2>&1; then
  echo "cargo-fuzz is missing: cargo install cargo-fuzz --locked --version 0.13.1" >&2
  exit 1
fi
targets=("$@")
if [ ${#targets[@]} -eq 0 ]; then
  mapfile -t targets < <(basename --suffix=.rs fuzz_targets/*.rs)
fi
echo "building the targets"
cargo +nightly fuzz build 2> /dev/null || cargo +nightly fuzz build
host=$(rustc +nightly --version --verbose | sed -n 's/^host: //p')
"${CARGO_TARGET_DIR:-target}/$host/release/seeds" corpus
failed=0
for target in "${targets[@]}"; do
  log=$(mktemp)
  outcome="none failed"
  # One input may take 10 seconds and 1 GiB; a parser's own bounds are asserted in its target.
  nice -n 19 cargo +nightly fuzz run "$target" -- -max_total_time="$seconds" \
    -timeout=10 -rss_limit_mb=1024 -print_final_stats=1 > "$log" 2>&1 || outcome="FAILED, see $log"
  inputs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
  echo "$target: ${inputs:-no} inputs in $seconds s, $outcome"
  if [ "$outcome" = "none failed" ]; then rm -f "$log"; else failed=1; fi
done
exit $failed
