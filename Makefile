# The verbs of Bagpipe. `make` alone lists them; every one can be interrupted and run again.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
MAKEFLAGS += --no-print-directory
# Steps that need nothing of each other run beside each other: some compute while others wait for the
# network. What is asked for in one line is done in its order, as people mean `make down demo`.
JOBS ?= $(shell echo $$(($$(nproc) + 2)))
ifeq ($(MAKELEVEL),0)
MAKEFLAGS += -j$(JOBS)
endif
ifneq ($(word 2,$(MAKECMDGOALS)),)
.NOTPARALLEL:
endif

export BAGPIPE_CACHE ?= $(HOME)/.cache/bagpipe
export PATH := $(BAGPIPE_CACHE)/bin/tools:$(PATH)
# Containers and CI set it, and then each process of the tests compiles all that it imports, and pytest
# rewrites all assertions in each of them.
unexport PYTHONDONTWRITEBYTECODE

CLUSTER_PY := python3 tests/cluster/cluster.py
STEP := @python3 tests/cluster/step.py
EMBEDDED_KUBECONFIG := /var/lib/bagpipe/kubeconfig
KIND_KUBECONFIG := $(BAGPIPE_CACHE)/kind.kubeconfig
KIND_VERSION := v0.30.0
UV_VERSION := 0.13.8
# Of this checkout; VERSION in the command is the one that is asked for.
NUMBER := $(file < VERSION)
NAMESPACE ?= bagpipe-system
IMAGE_NAMES := agent operator spark ros robot-state-publisher barrier-car exec-highway example-nodes ros2-standin ros2-rclpy
MODULE_CRATES := log packing pictures rosbag mcap rosbag2 formats
MEMORY_BAG_SOURCES := $(wildcard images/agent/Cargo.* images/agent/crates/python/*.* \
  images/agent/crates/python/src/*.rs images/build/module.py \
  $(foreach crate,$(MODULE_CRATES),images/agent/crates/$(crate)/Cargo.toml images/agent/crates/$(crate)/src/*.rs))
IMAGES := $(foreach name,$(IMAGE_NAMES),bagpipe.local/$(name):$(NUMBER))

# The demonstration by itself needs no others; whatever else is asked for gets all.
ifeq ($(filter-out demo first-verdict,$(or $(MAKECMDGOALS),help)),)
WANTED_IMAGES := agent operator spark ros robot-state-publisher
VENV := .venv/.runs
else
VENV := .venv/.synced
endif

# What runs the demonstration's job without Kubernetes.
LAPTOP := $(if $(filter demo first-verdict,$(MAKECMDGOALS)),laptop)

# What needs all packages gets them first: a compiler may be among them, or be replaced.
ALL_PACKAGES := test prepare set-up test-rust test-integration test-liars bench

# Each step's seconds, for the summary; who calls make several times gives one file to all, and sums up.
ifndef BAGPIPE_STEPS
SUMMARY := @python3 tests/cluster/step.py --summary
export BAGPIPE_STEPS := $(shell mkdir -p "$(BAGPIPE_CACHE)" && : > "$(BAGPIPE_CACHE)/steps.jsonl"; \
  echo "$(BAGPIPE_CACHE)/steps.jsonl")
endif

# embedded: tests/cluster, on this machine. kind: with Docker. existing: the current context.
# A KUBECONFIG that is there and not ours means a cluster of the user's.
ifeq ($(origin CLUSTER),undefined)
CLUSTER := $(if $(filter-out $(EMBEDDED_KUBECONFIG) $(KIND_KUBECONFIG),$(wildcard $(KUBECONFIG))),existing,embedded)
endif
ifneq ($(and $(NODES),$(filter-out embedded,$(CLUSTER))),)
$(error NODES=$(NODES) is for CLUSTER=embedded, and CLUSTER is $(CLUSTER))
endif
# A rebuilt operator keeps its tag: a digest of its contents, in the pod template, makes Kubernetes replace it.
ifeq ($(CLUSTER),embedded)
export KUBECONFIG := $(EMBEDDED_KUBECONFIG)
PREFLIGHT := cluster images tools $(LAPTOP)
OPERATOR_CONTENT = $$(sha256sum < $(BAGPIPE_CACHE)/images/operator.oci.json | cut -c1-16)
else ifeq ($(CLUSTER),kind)
export KUBECONFIG := $(KIND_KUBECONFIG)
PREFLIGHT := tools $(LAPTOP)
OPERATOR_CONTENT = $$(docker image inspect --format '{{.Id}}' bagpipe.local/operator:$(NUMBER))
else ifeq ($(CLUSTER),existing)
PREFLIGHT := tools images $(LAPTOP)
OPERATOR_CONTENT = none
else
$(error CLUSTER is $(CLUSTER); it can be embedded, kind or existing)
endif

.PHONY: help
help: ## List the verbs
	@awk -F ':.*## ' '/^[a-z0-9-]+:.*## / {printf "  make %-17s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
	@echo "  CLUSTER=embedded|kind|existing chooses the Kubernetes; it is $(CLUSTER) now."
	@echo "  NODES=3 gives the embedded one as many nodes (one by default), each with its own kubelet."

# The first verdict needs little of what the cluster does: it is there while Kubernetes compiles.
.PHONY: demo
demo: first-verdict cluster install ## Set everything up, run the main job, show the result
	$(STEP) "Running the demonstration" -- .venv/bin/python -m tests.e2e.demo
	$(SUMMARY)

.PHONY: first-verdict
first-verdict: recording agent .venv/.memory-bag ## Run the demonstration's job on this machine, without Kubernetes
	$(STEP) "Running the demonstration's job without Kubernetes" -- .venv/bin/python -m tests.e2e.first_verdict

# So many processes share the tests; those of a file, and of a folder with servers, stay together.
# Each may have a Spark, an HDFS or an API server of its own. One more than there are processors has something to
# do while others wait, and two more where most wait for nodes and servers: with three in all, two processors took
# 13 min 47 s for these tests, and with four 11 min 33 s.
PROCESSORS := $(shell echo $$(($$(nproc) > 4 ? 4 : $$(nproc))))
BESIDE := --numprocesses $(or $(LANES),$(shell echo $$(($(PROCESSORS) + 1)))) --dist loadscope
BESIDE_WAITING := --numprocesses $(or $(LANES),$(shell echo $$(($(PROCESSORS) + 2)))) --dist loadscope
# SEED=7 in the command gives the tests another order, each number its own; what a test draws by
# chance stays so, but for what is drawn while tests are collected.
ORDER := $(if $(filter command,$(firstword $(origin SEED))),-p randomly --randomly-seed=$(SEED) --randomly-dont-reset-seed)
PYTEST := .venv/bin/python -m pytest $(ORDER)

# Parts of names, as pytest's -k takes them: of the tests that need neither cluster nor cargo.
.PHONY: test
ifdef K
test: preflight-all venv tools ## Set everything up, run all tests (K=resume: only those of that name)
	$(STEP) "Testing $(K)" -- $(PYTEST) tests/unit tests/cluster tests/integration tests/liars -k "$(K)"
else
# What computes comes first, and what measures the machine before it. Of what waits for sockets and nodes
# two halves run beside each other; whole jobs on the cluster run beside nothing but each other.
test: set-up
	@$(MAKE) test-together-alone
	@$(MAKE) test-python
	@$(MAKE) test-real-parts AND=tests/liars
	@$(MAKE) test-e2e
	$(SUMMARY)
endif

# The caller's environment may have a variable of this name.
AT_ITS_END :=

.PHONY: test-real-parts
test-real-parts: AT_ITS_END := --output-at-its-end
test-real-parts: test-rust test-together
# Else a test that builds with cargo waits there for as long as the agent's tests are compiled.
ifneq ($(filter test-real-parts,$(MAKECMDGOALS)),)
test-together: test-agent
endif

# Of a clean checkout: the compilers of lint, site and tests fill each other's waits.
.PHONY: prepare
prepare: lint docs set-up ## Check style, build the documentation and all that tests need, at once

.PHONY: set-up
set-up: preflight-all venv tools test-programs test-agent fastdds rclpy npm-packages recording images ## Build all that tests need, at once

.PHONY: quick
quick: venv ## Check what differs from SINCE=HEAD in under a minute: style, and the nearest unit tests
	$(STEP) "Checking what has changed" -- .venv/bin/python -m tests.quick.run --since "$(or $(SINCE),HEAD)"

.PHONY: watch
watch: venv ## Check what differs from SINCE=HEAD whenever a file is saved, until Ctrl-C
	@.venv/bin/python -m tests.quick.watch --since "$(or $(SINCE),HEAD)"

.PHONY: test-one
test-one: venv $(if $(filter tests/e2e/%,$(T)),cluster install) ## Run one test: T=FILE or T=FILE::NAME, in Python or Rust
	$(CLAIM)
	@env -u MAKEFLAGS -u MFLAGS CARGO_TARGET_DIR="$(BAGPIPE_CACHE)/cargo-debug" .venv/bin/python -m tests.quick.one $(T)

.PHONY: fmt
fmt: venv ## Format all Python and Rust, and mend what ruff can mend
	$(STEP) "Formatting" -- bash -euc '.venv/bin/ruff check --quiet --fix --exit-zero .; .venv/bin/ruff format --quiet .; \
	  cd images/agent; cargo fmt --all'

# Else whichever test is first would build them, and take minutes.
.PHONY: test-programs
test-programs: kubernetes
	$(STEP) "Building what tests start" --if-it-fails "Is the Go module proxy reachable? Then run it again." -- \
	  nice $(CLUSTER_PY) build helm-unittest versitygw crane registry

# The longest of all, of several threads each as heavy as one of another step: at the lowest priority
# it takes what the other steps leave, and then everything.
.PHONY: kubernetes
kubernetes: machine
	$(STEP) "Building Kubernetes" --if-it-fails "Is the Go module proxy reachable? Then run it again." -- \
	  nice -n 19 $(CLUSTER_PY) build kubernetes pause

.PHONY: test-python
test-python: venv tools test-programs ## Run the Python unit tests (part of test)
	$(STEP) "Testing the Python packages and the cluster's parts" -- $(PYTEST) $(BESIDE) tests/unit tests/cluster

.PHONY: recording
recording: preflight ## Fetch the real recording that the tests play
	$(STEP) "Getting the PR2 recording" --if-it-fails "Is the Debian mirror reachable? Then run it again." -- \
	  python3 -m tests.recording

# Else what another checkout has built there would be taken for this one's.
CLAIM = @python3 images/build/claim.py "$(BAGPIPE_CACHE)/cargo-debug"
# Its tests wait for nodes and players: two at once leave the processors idle.
TEST_AGENT := env -u MAKEFLAGS -u MFLAGS -C images/agent \
  RUST_TEST_THREADS=$(shell echo $$(($(PROCESSORS) * 2 + 1))) CARGO_TARGET_DIR="$(BAGPIPE_CACHE)/cargo-debug" cargo test --locked --workspace

.PHONY: test-agent
test-agent: preflight-all
	$(CLAIM)
	$(STEP) "Compiling the agent's tests" --if-it-fails "Is the crates' registry reachable? Then run it again." -- \
	  nice $(TEST_AGENT) --quiet --no-run

# Another implementation of DDS than the stand-in of ROS 2 has: 4 s.
.PHONY: fastdds
fastdds: preflight-all
	$(STEP) "Building the endpoint over Fast DDS" -- python3 -m tests.ros2_standin fastdds

# Real nodes of ROS 2, and the librcl and Fast DDS that they run on: 12 s.
.PHONY: rclpy
rclpy: preflight-all venv
	$(STEP) "Getting rclpy" --if-it-fails "Is the package index reachable? Then run it again." -- .venv/bin/python -m tests.ros2_rclpy.wheels

# The packages that a folder's lock ($(1)) names, each with its hash, into another ($(2)), unless they
# are there; no script of theirs is run. Node.js is in .venv.
define NPM_CI
bash -euc 'if [ -d "$(2)/node_modules" ] && cmp -s $(1)/package-lock.json "$(2)/package-lock.json"; then exit; fi; \
	    rm -rf "$(2).new"; mkdir -p "$(2).new"; cp $(1)/package*.json "$(2).new"; \
	    PATH="$$PWD/.venv/bin:$$PATH" npm ci --prefix "$(2).new" --ignore-scripts --no-audit --no-fund --silent; \
	    rm -rf "$(2)"; mv "$(2).new" "$(2)"'
endef
NPM_LOCK := images/agent/crates/mcap/tests/languages
NPM_FOLDER := $(BAGPIPE_CACHE)/npm/mcap
.PHONY: npm-packages
npm-packages: $(VENV)
	$(STEP) "Getting npm's packages" --if-it-fails "Is the npm registry reachable? Then run it again." -- \
	  $(call NPM_CI,$(NPM_LOCK),$(NPM_FOLDER))

# Nothing else needs these 300 packages: Grafana's components, which draw the dashboards.
PICTURES_LOCK := tests/pictures/board
PICTURES_FOLDER := $(BAGPIPE_CACHE)/npm/pictures
.PHONY: pictures
pictures: preflight-all venv test-programs recording agent ## Make the documentation's pictures of dashboards and report again
	$(STEP) "Getting Grafana's components" --if-it-fails "Is the npm registry reachable? Then run it again." -- \
	  $(call NPM_CI,$(PICTURES_LOCK),$(PICTURES_FOLDER))
	$(STEP) "Making pictures" -- env BAGPIPE_PICTURES_PACKAGES="$(PICTURES_FOLDER)" $(PYTEST) tests/pictures/make.py

# Without ROS or the recording its tests fail; BAGPIPE_WITHOUT_ROS=1 leaves out what needs ROS.
.PHONY: test-rust
test-rust: recording test-agent fastdds npm-packages ## Run the agent's tests, against Debian's ROS (part of test)
	$(STEP) "Testing the agent" $(AT_ITS_END) -- $(TEST_AGENT) --no-fail-fast

.PHONY: stalls
stalls: recording test-agent fastdds npm-packages ## Run the agent's tests while processes and threads stand still at random (SEED=7, TESTS='ros2/ rest')
	$(STEP) "Stalling the agent's tests" --if-it-fails "It says above who stood still when; SEED= has the same pauses again." -- \
	  env -u MAKEFLAGS -u MFLAGS CARGO_TARGET_DIR="$(BAGPIPE_CACHE)/cargo-debug" \
	  .venv/bin/python -m tests.stalls.run $(if $(SEED),--seed $(SEED)) $(TESTS)

.PHONY: test-integration
test-integration: test-together ## Run worker, agent and real nodes together (part of test)
	@$(MAKE) test-together-alone

.PHONY: test-together
test-together: preflight-all venv test-programs rclpy recording agent
	$(STEP) "Testing worker, agent and real nodes" -- $(PYTEST) $(BESIDE_WAITING) -m "not alone and not slow" tests/integration $(AND)

.PHONY: test-together-alone
test-together-alone: preflight-all venv test-programs recording agent rclpy
	$(STEP) "Testing what measures the machine" -- $(PYTEST) -m alone tests/integration

# Not part of test: it needs a ROS 2, sourced or as an image, which is asked for before anything is
# built. OPTIONS are pytest's.
.PHONY: test-ros2
test-ros2: ## Test under a real ROS 2: one that is sourced, or ROS2_IMAGE=ros:jazzy
	@python3 -m tests.ros2_real.place
	@$(MAKE) venv agent
	$(STEP) "Testing under a real ROS 2" --if-it-fails "It says above which test failed." -- \
	  .venv/bin/python -m tests.ros2_real.run $(OPTIONS)

.PHONY: test-liars
test-liars: preflight-all venv ## Put stacks that lie, and odd honest ones, before the gate (part of test)
	$(STEP) "Testing that no liar passes" -- $(PYTEST) tests/liars

.PHONY: test-e2e
test-e2e: venv cluster install ## Run whole jobs on the cluster (part of test)
	$(STEP) "Testing whole jobs on Kubernetes" -- $(PYTEST) $(BESIDE) tests/e2e -m "not (slow or nodes or alone)"
	$(STEP) "Testing how soon trouble is reported" -- $(PYTEST) tests/e2e -m "alone and not slow"

.PHONY: test-slow
test-slow: venv cluster install release-programs release-platforms recording ## Test an upgrade, two operators, and what else takes minutes
	$(STEP) "Testing what takes minutes" -- $(PYTEST) tests/e2e tests/integration/kubectl_plugin tests/integration/release -m slow

# On a machine that has no registry in reach, or whose Docker may not do all that a node wants.
.PHONY: test-kind
test-kind: ## Run `make demo CLUSTER=kind` with an engine and a node that are made for it here
	$(STEP) "Getting what kind needs" -- $(CLUSTER_PY) preflight cluster images kind tools laptop
	$(STEP) "Running the demonstration on kind" --if-it-fails "It says above what stopped it." -- \
	  env PYTHONPATH=tests/cluster python3 -m kind.rig $(MAKE) demo CLUSTER=kind

.PHONY: test-nodes
ifeq ($(CLUSTER),embedded)
# On any other number of nodes all its tests are skipped, which would look like success.
test-nodes: override NODES := 3
test-nodes: venv cluster install ## Test three nodes, their loss, and 200 cases that are disturbed
	$(STEP) "Testing a cluster of three nodes" -- $(PYTEST) \
	  tests/e2e/test_nodes.py tests/e2e/test_fleet_faults.py
else
test-nodes:
	$(error test-nodes cuts nodes off, which only the embedded cluster can: CLUSTER=embedded)
endif

.PHONY: bench
bench: preflight-all venv ## Measure beside the peers (BENCH=bag, play, binpipe, cache, scale, fleets, operator, gate, report, spark_start, start, tail or ros2)
	$(STEP) "Measuring" -- .venv/bin/python tests/bench/run.py $(BENCH)

.PHONY: fuzz
ifeq ($(TARGET),manifests)
fuzz: venv tools
	$(STEP) "Fuzzing the operator with manifests" --if-it-fails "It says above what failed, and how to do it again." -- \
	  env PYTHONPATH=.:tests/cluster .venv/bin/python -m tests.fuzz.manifests.run $(or $(SECONDS),60) \
	  $(if $(SEED),--seed $(SEED)) $(if $(BATCH),--batch $(BATCH))
else
fuzz: ## Fuzz the agent's parsers, each for SECONDS=60 (TARGET=scan: only that; TARGET=manifests: the operator)
	$(STEP) "Fuzzing" --if-it-fails "It says above what is missing, or which input failed." -- \
	  env CARGO_TARGET_DIR="$(BAGPIPE_CACHE)/cargo-fuzz" images/agent/fuzz/run.sh $(or $(SECONDS),60) $(TARGET)
endif

.PHONY: mutants
mutants: venv ## Break modules line by line, and name the breaks that no unit test notices (FILES='a.py b.py')
	$(STEP) "Breaking the code" -- .venv/bin/python -m tests.mutation.run $(FILES)

.PHONY: mutants-rust
mutants-rust: venv ## Break the agent's deciders, and name the breaks that no unit test notices (FILES='a.rs b.rs')
	$(STEP) "Breaking the agent" --if-it-fails "It says above what is missing, or in which file too few were killed." -- \
	  .venv/bin/python -m tests.mutation.rust $(FILES)

.PHONY: lint
lint: lint-sources lint-charts ## Check style and types of everything

# What ends continuous integration before its long tests.
.PHONY: check
check: lint docs test-python ## Check all that needs neither nodes nor a cluster, before a commit

.PHONY: lint-sources
lint-sources: venv
	$(CLAIM)
	$(STEP) "Linting" -- tests/lint.sh

# By helm itself, which is built with Kubernetes.
.PHONY: lint-charts
lint-charts: tools
	$(STEP) "Linting the charts" -- bash -euc 'helm lint --quiet --namespace bagpipe-system charts/bagpipe; \
	  helm lint --quiet --namespace lanes charts/bagpipe-namespace'

.PHONY: docs
docs: venv ## Build the documentation's site into build/docs; a dead link is an error
	$(STEP) "Building the documentation" --if-it-fails "It says above which page has what fault." -- \
	  bash -euc '.venv/bin/python -m tests.promises.page --check; .venv/bin/python -m docs.site.architecture --check; .venv/bin/python -m docs.site.pipe_maps --check; \
	    .venv/bin/python -m docs.site.build build/docs'

.PHONY: tools
tools: preflight $(if $(filter embedded,$(CLUSTER)),kubernetes) ## Get kubectl and helm, built where the machine's are too old
	$(STEP) "Getting kubectl and helm" -- $(CLUSTER_PY) tools

.PHONY: machine
machine:
	$(STEP) "Checking this machine" -- $(CLUSTER_PY) check

.PHONY: preflight
preflight: machine $(if $(filter $(ALL_PACKAGES),$(MAKECMDGOALS)),preflight-all)
	$(STEP) "Getting Debian's packages" -- $(CLUSTER_PY) preflight $(PREFLIGHT)

.PHONY: preflight-all
preflight-all: machine
	$(STEP) "Getting all of Debian's packages" -- $(CLUSTER_PY) preflight

.PHONY: venv
venv: .venv/.memory-bag ## Make .venv with the pinned Python packages and bagpipe.MemoryBag

SYNC = $(STEP) "Making .venv from uv.lock" --if-it-fails "Is the Python package registry reachable? Then run it again." -- \
  bash -euc 'python3 -m venv .venv; \
    .venv/bin/pip install --quiet --disable-pip-version-check uv==$(UV_VERSION); \
    .venv/bin/uv sync --quiet --frozen --all-packages --all-extras $(1); touch $(2)'
LOCKED := uv.lock pyproject.toml operator/pyproject.toml images/spark/pyproject.toml

.venv/.synced: $(LOCKED) | preflight
	$(call SYNC,,.venv/.runs $@)

# What runs Bagpipe and builds its images, without what tests and checks it; it takes nothing away.
.venv/.runs: $(LOCKED) | preflight
	$(call SYNC,--inexact --no-default-groups --group build --group demo,$@)

# Not in uv.lock: cargo builds it from these sources. A sync removes it, so it comes after one.
.venv/.memory-bag: $(VENV) $(MEMORY_BAG_SOURCES)
	$(STEP) "Building bagpipe.MemoryBag into .venv" --if-it-fails "Is the crates' registry reachable? Then run 'make venv' again." -- \
	  .venv/bin/python images/build/module.py
	@touch $@

.PHONY: agent
agent: preflight
	$(STEP) "Building the agent" --if-it-fails "Is the crates' registry reachable? Then run it again." -- \
	  python3 images/build/agent.py

# Of the demonstration at a lower priority than the agent, which the first verdict waits for. Before tests
# nothing else takes as long one thing after the other.
.PHONY: images
images: FOR_IMAGES := $(if $(LAPTOP),nice -n 15)
images: preflight $(VENV) ## Build all images (`make cluster` loads them)
ifeq ($(CLUSTER),kind)
	$(STEP) "Building images" -- $(FOR_IMAGES) python3 images/build/build.py --engine docker --no-archives $(WANTED_IMAGES)
else
	$(STEP) "Building images" -- $(FOR_IMAGES) python3 images/build/build.py $(WANTED_IMAGES)
endif

.PHONY: plugin
plugin: venv ## Pack `kubectl bagpipe` for krew into FOLDER (the cache by default; URI= says where it will be)
	$(STEP) "Packing the kubectl plugin" -- .venv/bin/python images/build/plugin.py \
	  "$(or $(FOLDER),$(BAGPIPE_CACHE)/plugin)" $(if $(URI),--uri "$(URI)")

.PHONY: wheels
wheels: preflight venv ## Build a wheel of bagpipe, its native module and the agent into FOLDER (the cache by default)
	$(STEP) "Building the wheels" -- .venv/bin/python images/build/wheels.py "$(or $(FOLDER),$(BAGPIPE_CACHE)/wheels)"

# Of a commit that says so itself: VERSION names the number that the file VERSION has.
RELEASE := env PYTHONPATH=images/build:tests/cluster .venv/bin/python -m release
DIST := $(or $(FOLDER),dist)

.PHONY: version
version: ## Write VERSION=0.3.0 into every place that repeats the version
	@python3 -m release.version $(VERSION)

.PHONY: release-programs
release-programs: preflight
	$(STEP) "Building what releases are made and pushed with" --if-it-fails "Is the Go module proxy reachable? Then run it again." -- \
	  nice $(CLUSTER_PY) build syft crane

# Compilers for platforms other than this machine's, before anything else is built.
PLATFORMS ?= linux/amd64 linux/arm64
COMMA := ,
.PHONY: release-platforms
release-platforms: preflight
ifneq ($(word 2,$(subst $(COMMA), ,$(PLATFORMS))),)
	$(STEP) "Getting compilers for $(PLATFORMS)" --if-it-fails "PLATFORMS= names fewer." -- $(CLUSTER_PY) preflight cross
endif

.PHONY: release
release: preflight venv release-programs release-platforms ## Make all that registries and indexes take of VERSION=0.2.0 in FOLDER=dist (PLATFORMS=, REGISTRY=, DOWNLOADS=, KEY=)
	$(STEP) "Building images" -- nice -n 5 python3 images/build/build.py --platforms "$(PLATFORMS)" agent operator spark
	$(STEP) "Making the release" --if-it-fails "It says above what is missing." -- $(RELEASE).make "$(VERSION)" --folder "$(DIST)" --platforms "$(PLATFORMS)" \
	  $(if $(REGISTRY),--registry "$(REGISTRY)") $(if $(DOWNLOADS),--downloads "$(DOWNLOADS)") $(if $(KEY),--key "$(KEY)")

.PHONY: push
push: tools venv release-programs ## Push images and charts of the release in FOLDER=dist to REGISTRY=host/path (PLAIN_HTTP=1, CHARTS_ONLY=1)
	$(STEP) "Pushing the release" --if-it-fails "It says above why." -- $(RELEASE).push "$(DIST)" \
	  "$(or $(REGISTRY),$(error push needs REGISTRY=host/path))" $(if $(PLAIN_HTTP),--plain-http) $(if $(CHARTS_ONLY),--charts-only)

.PHONY: up
up: preflight tools
	$(STEP) "Starting Kubernetes on this machine" --if-it-fails "'make down' cleans up; then try again." -- $(CLUSTER_PY) up $(if $(NODES),--nodes $(NODES))

.PHONY: cluster
cluster: images $(if $(filter embedded,$(CLUSTER)),up) ## Start Kubernetes if there is none and load the images
ifeq ($(CLUSTER),embedded)
	$(STEP) "Loading images" -- $(CLUSTER_PY) load
else ifeq ($(CLUSTER),kind)
	$(STEP) "Getting kubectl, helm and kind" -- bash -euc '$(CLUSTER_PY) tools; \
	  command -v kind || GOBIN=$(BAGPIPE_CACHE)/bin/tools go install sigs.k8s.io/kind@$(KIND_VERSION)'
	$(STEP) "Starting Kubernetes in Docker" -- bash -euc 'kind get clusters | grep -qx bagpipe || \
	  kind create cluster --name bagpipe --config tests/cluster/kind.yaml --wait 3m $(if $(KIND_IMAGE),--image "$(KIND_IMAGE)")'
	$(STEP) "Loading images" -- kind load docker-image --name bagpipe $(or $(WANTED_IMAGES:%=bagpipe.local/%:$(NUMBER)),$(IMAGES))
else
	$(STEP) "Getting kubectl and helm" -- $(CLUSTER_PY) tools
	$(STEP) "Looking for your cluster" --if-it-fails "Set KUBECONFIG, or use CLUSTER=embedded." -- kubectl version
	@echo "    Your nodes must be able to pull the images: push $(IMAGES)"
	@echo "    to a registry of yours and set the chart's image values to it."
endif

# The demonstration and the end-to-end tests have jobs in namespaces that they make: clusterWide.
.PHONY: install
install: cluster ## Install the CRD and the chart with Helm
	$(STEP) "Installing the chart" --if-it-fails "See 'kubectl -n $(NAMESPACE) describe pods'." -- \
	  helm upgrade --install bagpipe charts/bagpipe --namespace $(NAMESPACE) --create-namespace --wait --timeout 3m \
	  --set clusterWide=true --set pools.enabled=true \
	  --set-string "operator.podAnnotations.sim\.bagpipe\.io/image-content=$(OPERATOR_CONTENT)"

.PHONY: uninstall
uninstall: ## Remove the chart
	$(STEP) "Removing the chart" -- helm uninstall bagpipe --namespace $(NAMESPACE) --ignore-not-found --wait

.PHONY: down
down: ## Remove the cluster: every process, mount, namespace and file that it made
ifeq ($(CLUSTER),kind)
	$(STEP) "Removing the kind cluster" -- kind delete cluster --name bagpipe
else ifeq ($(CLUSTER),existing)
	@echo "The cluster is yours: 'make uninstall' removes Bagpipe from it."
else
	$(STEP) "Removing the cluster" -- $(CLUSTER_PY) down
	$(STEP) "Releasing the image builder" -- python3 images/build/build.py --release
endif

.PHONY: clean
clean: down ## Remove the caches as well (binaries, images, .venv)
	$(STEP) "Removing $(BAGPIPE_CACHE) and .venv" -- \
	  bash -euc 'python3 images/build/build.py --clean; rm -rf --one-file-system .venv'
