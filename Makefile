# The front door. On a fresh Debian 12, `make demo` and `make test` each do all that is needed: set up, build, run.
SHELL := /bin/bash
.DEFAULT_GOAL := help
# the recipes are stages: one after the other also under make -j
.NOTPARALLEL:
# release, debug or asan: what build makes and test runs
PROFILE ?= release
export PHRI_PROFILE := $(PROFILE)
.PHONY: demo test check study figures soak bench realtime docs tidy build setup clean help

demo: build     ## set up, build, run the maze experiment (rviz when there is a display), record it, print table and report
	@scripts/demo.sh

test: build     ## set up, build, run gtest, rostest and pytest; last line: N passed, N failed (K=text: only these; PROFILE=debug or asan)
	@. scripts/env.sh && scripts/test.py $(if $(K),-k '$(K)')

check: build    ## format, lint, launch files, layer rules; non-zero on any finding
	@. scripts/env.sh && scripts/check.sh

study: build    ## an evaluation into results/studies (STUDY=maze_assistance, calibration or validation)
	@. scripts/env.sh && phri-analysis study $(or $(STUDY),maze_assistance)

figures: build  ## figures of the thesis (chapters 3 to 5) with CSV, setting and findings, in results/figures (ID=4.5: only these)
	@. scripts/env.sh && phri-analysis figures --jobs 2 $(if $(ROLLOUTS),--rollouts $(ROLLOUTS)) $(ID)

soak: build     ## two million random problems of the solvers, on all cores (PHRI_SOAK=10: a tenth); last line: N problems, N failed
	@. scripts/env.sh && scripts/soak.sh

bench: build    ## speed beside crocoddyl, hmmlearn, pybullet and mujoco in the same run (PEERS=no: without them)
	@. scripts/env.sh && scripts/bench.sh

realtime: build ## a minute at 1 kHz with recording: how late the ticks came (EXPERIMENT=emerging_assistance: learning meanwhile)
	@scripts/realtime.sh

docs: build     ## this documentation as a site that needs no network, in results/docs/html
	@. scripts/env.sh && scripts/docs.sh

tidy: build     ## clang-tidy on the C++ sources of libraries and nodes (minutes)
	@scripts/tidy.sh

build: setup    ## set up, build the workspace and its tests (JOBS=n compilers at once; PROFILE=debug or asan)
	@scripts/build.sh $(PROFILE)

setup:          ## install the packages that are missing (Debian 12, root or sudo); all the others do this first
	@docker/setup.sh

clean:          ## delete what the builds left; results/ stays
	rm -rf catkin_ws/{build,devel,logs}{,_debug,_asan} catkin_ws/.catkin_tools/profiles/{release,debug,asan}

help:           ## this list
	@awk -F ':.*## ' '/^[a-z]+:.*## /{printf "  make %-9s %s\n", $$1, $$2}' $(firstword $(MAKEFILE_LIST))
	@echo
	@echo "A Debian image without make: apt-get install -y make, or docker/setup.sh, which installs make as well."
	@echo "Another system than Debian 12: any target prints the docker commands."
