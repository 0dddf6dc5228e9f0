# SPDX-License-Identifier: Apache-2.0
# Every target does all its own set-up.
SHELL := /bin/bash
.DEFAULT_GOAL := help
# One file's tests stay in one process, in the order they are collected in: what they share is
# computed once.
IN_PARALLEL := -n 2 --dist loadfile --no-loadscope-reorder
.PHONY: help setup demo test test-web test-long test-odd lint clean

help: ## List the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

setup: ## Make .venv, build with colcon, write env.sh
	@tools/setup_workspace.sh

demo: ## Simulate, fit, compare; writes demo/report.html and demo/report.json
	@tools/setup_workspace.sh
	@. ./env.sh && python -m imu_workbench demo -o demo

test: ## Run the tests; its summary counts those left to test-long
	@tools/setup_workspace.sh requirements-dev.txt
	@. ./env.sh && export ROS_PYTHON_CHECK_FIELDS=1 && python -m pytest $(IN_PARALLEL) $(PYTEST_ARGS)

test-web: ## Test the web page in headless Chromium (apt install chromium)
	@tools/setup_workspace.sh requirements-dev.txt
	@. ./env.sh && python -m pytest test/web -o python_files='*_in_browser.py' $(IN_PARALLEL) $(PYTEST_ARGS)

test-long: ## Run the further cases that make test leaves out
	@tools/setup_workspace.sh requirements-dev.txt
	@. ./env.sh && python -m pytest -m long -o python_files='test_*.py *_in_browser.py' $(IN_PARALLEL) $(PYTEST_ARGS)

test-odd: ## Test every verb with every odd recording (more than half an hour)
	@tools/setup_workspace.sh requirements-dev.txt
	@. ./env.sh && export ODD_RECORDINGS=all && python -m pytest test/imu_workbench/commands/test_odd_recordings.py -n 2 $(PYTEST_ARGS)

lint: ## ruff and mypy
	@tools/setup_workspace.sh requirements-dev.txt
	@. ./env.sh && ruff check . && ruff format --check . && mypy src

clean: ## Remove everything the set-up made
	rm -rf .venv build install log env.sh demo
