#!/bin/bash
# Style, types, direction of dependencies, in every language of the project.
set -euo pipefail
cd "$(dirname "$0")/.."
export PATH="$PWD/.venv/bin:$PATH"

step() {
  echo "--- $1"
  shift
  "$@"
}

step "ruff" ruff check .
step "ruff format" ruff format --check .
step "mypy, the packages" mypy --package bagpipe --package bagpipe_operator
step "mypy, the tests" mypy tests/unit tests/integration tests/ros2_real tests/toy_engine tests/toy_source tests/liars tests/e2e tests/bench tests/fuzz tests/quick tests/mutation tests/promises \
  --exclude tests/bench/nodes --exclude tests/ros2_real/nodes/ --exclude tests/integration/nodes --exclude tests/liars/stacks
step "mypy, the cluster" env -C tests/cluster mypy --config-file ../../pyproject.toml cluster.py step.py kind/rig.py kind/bounded.py
step "mypy, the images" env -C images/build mypy --config-file ../../pyproject.toml agent.py build.py module.py plugin.py wheels.py ../spark/class_archive.py
step "mypy, the documentation's site" mypy docs/site charts/reference.py release
step "import-linter" lint-imports
step "words" tests/words.sh
step "rustfmt" env -C images/agent cargo fmt --all --check
step "clippy" env -C images/agent CARGO_TARGET_DIR="${BAGPIPE_CACHE:-$HOME/.cache/bagpipe}/cargo-debug" \
  cargo clippy --locked --workspace --all-targets --quiet -- -D warnings
mapfile -t scripts < <(git ls-files '*.sh' '.ci/*')
step "shellcheck" shellcheck "${scripts[@]}"
step "gofmt" test -z "$(gofmt -l tests/cluster)"
echo "lint: all clean"
