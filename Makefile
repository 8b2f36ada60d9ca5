# make setup   .venv with everything, at the locked versions
# make demo    the main job: 216 spheres in every engine that is here, then a robot arm: about 20 minutes on two busy processors
# make engines   engines that need more than pip: installed where that is possible (root, apt-get); fails where one is missing then; ENGINES="ode drake" those alone
# make test    what CI runs: lint, types, stale files, tests
# make check   lint, types (mypy, strict) and stale files alone (make types, make stale: one half)
# make quick   the developer's loop: lint, and the tests that start no engine, nor another process of their own
# make random-worlds COUNT=200   random scenarios, compiled, proven and run in every engine
# make fuzz LANGUAGE=urdf MINUTES=10   damaged and hostile files for an importer, so many minutes of processor time
# make selftest   every change that compiled files can suffer, in every engine, and its table in docs/records/self-test.md: about an hour
# make newest  the newest Python that has wheels of engines, where it is installed: a first run and some tests: under a minute
# make certify  every shipped spec, proven in every engine that is here and supports it (nightly): about half an hour on two processors
# make slow     tests that are left out of make test, since they take long (nightly): every defect and every probe in every engine, a bisection of installed versions, the robot's placements, the CI example from end to end: some 25 minutes
# make nightly  slow, certify, selftest, kills, random worlds, fuzz: hours; outcomes in docs/records/nightly.md
# make kills    compile, verify, run and a sweep, each killed 20 times at a random moment: nothing lost, nothing left: some minutes
# make scenario-full   the robot scenario, 279 s in every engine at 1 ms: some minutes
# make study-small   both scenarios of the study, 5 timesteps, 3 seeds, 3 engines, one pick of the robot: runs/koerber-2021-small/study.md
# make study    the whole study: hours; ended at any moment, the same command does what is left
# make study-contact   the contact law in every engine at six timesteps, towers, costs: docs/records/contact.md anew: some 25 minutes
# make corpora   robot files of packages that pip installs: imported, certified, audited: docs/records/corpora.md anew; hours, and ended at any moment it goes on
# make site     the documentation as a site: build/site/index.html; fails where a link is broken
# make page-bundle   the program of the HTML report, anew from page/src: needs Node.js 20 and npm's registry
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
# one more than processors, up to 8: tests wait for processes of engines in a third of their time (measured)
JOBS ?= $(shell n=$$(getconf _NPROCESSORS_ONLN); [ $$n -lt 8 ] && echo $$((n + 1)) || echo 8)
# Tests start a thousand interpreters. Where this is set, each compiles all of simspec anew: 17 to 28 % of a short one (measured)
unexport PYTHONDONTWRITEBYTECODE

.PHONY: corpora newest engines setup demo test suite quick check types stale generated lock benchmarks scenario-full random-worlds fuzz selftest certify slow kills nightly study study-small study-contact site page-bundle clean

setup: .venv/ready

# the environment, and its installer, with which tools/newest.sh fills another one meanwhile (tools/install.sh says what follows without)
.venv/bin/pip:
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info[:2] == (3, 11) else "simspec needs Python 3.11 (wheels of pybullet end there); say make PYTHON=/path/to/python3.11")'
	$(PYTHON) -m venv .venv
	-PIP_CONSTRAINT=$(CURDIR)/constraints.txt $(BIN)/pip install --quiet --disable-pip-version-check --no-compile uv

# The former name of the distribution is uninstalled: an older environment would list every plug-in twice
.venv/ready: pyproject.toml constraints.txt | .venv/bin/pip
	@$(BIN)/pip uninstall --quiet --disable-pip-version-check --yes simspec 2>/dev/null
	tools/install.sh .venv '.[all,test,rapier]'
	@# processes that read the files of strangers write nothing, not even what they compile
	$(BIN)/python -c 'import mujoco; from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade, Vt'
	touch $@

# SIMSPEC_DEMANDED_ENGINES=all make test fails where one is not there; by default its tests are skipped, and named
ENGINES ?= --all
engines: setup
	-$(BIN)/simspec engines install $(ENGINES) --yes
	$(BIN)/simspec engines doctor $(ENGINES)

demo: setup
	$(BIN)/simspec run specs/spheres-216.yaml --all-engines
	$(BIN)/simspec run specs/ur10e.yaml --all-engines

# pages that are filled from the studies in docs/records/studies, as soon as these are published. Every commit checks one of them, and
# by compile --check the specs of the others; make slow checks all, for which it compiles 529 models
PAGES := docs/records/results.md $(if $(wildcard docs/records/studies/koerber-2021/study.json.gz),docs/records/stacking.md) \
	$(if $(wildcard docs/records/studies/contact/study.json.gz),docs/records/contact.md)

# specs whose certificates take two thirds of the time that all take to judge, since their motions are planned anew. A commit judges
# the other thirteen, and these without their motions (tests/test_library.py); make slow judges all
LONG := four-bar-push spheres-216 stack-cylinders

check: types stale

types: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python tools/check_types.py

stale: setup
	$(BIN)/simspec schema --check
	$(BIN)/simspec schema --of engine-request --check
	$(BIN)/simspec schema --of engine-result --check
	$(BIN)/simspec schema --of project --check
	$(BIN)/simspec schema --of study --check
	$(BIN)/simspec schema --of figures --check
	$(BIN)/simspec fmt --check specs/*.yaml specs/models/*.yaml specs/contact/*.yaml specs/motion/*.yaml specs/studies/*.yaml
	$(BIN)/simspec engines --markdown --check
	$(BIN)/simspec compile --check $(filter-out $(LONG:%=specs/%.yaml),$(wildcard specs/*.yaml))
	$(BIN)/simspec pages --check docs/records/contact.md

# both halves of check side by side; the tests begin when the first of them is done
test: setup
	$(MAKE) -j2 check suite

# a worker that died ends the tests: without it, the others wait for its files until somebody ends them
suite: setup
	$(BIN)/pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder --max-worker-restart 0 --durations=10

# the language, the world, formats, comparisons, reports: all that needs no engine at work
QUICK := tests/language tests/world tests/control tests/comparison tests/report tests/dynamics \
	tests/formats tests/test_house.py tests/resolve tests/support tests/contact tests/dialects \
	tests/runner/test_store.py tests/runner/test_metrics.py tests/runner/test_expectations.py
# of these, what starts engines or readers of files in processes of their own: a third of the time, left to make test
BUT := tests/formats/usd tests/resolve/test_meshes.py tests/comparison/test_long.py $(wildcard tests/report/test_study_*.py)

newest:
	tools/newest.sh

quick: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pytest -q -n $(JOBS) --dist loadfile -m "not slow and not browser" --durations=10 $(BUT:%=--ignore=%) $(QUICK)

# what is committed under generated/, docs/ and schema/, made anew
generated: setup
	$(BIN)/simspec schema
	$(BIN)/simspec schema --of engine-request
	$(BIN)/simspec schema --of engine-result
	$(BIN)/simspec schema --of project
	$(BIN)/simspec schema --of study
	$(BIN)/simspec schema --of figures
	$(BIN)/simspec engines --markdown
	$(BIN)/python tools/readme.py
	$(BIN)/python tools/tutorials.py
	$(BIN)/python tools/gallery.py
	for spec in specs/*.yaml; do $(BIN)/simspec compile $$spec && $(BIN)/simspec verify $$spec || exit 1; done

# newest versions that pyproject.toml allows; then make test, and commit constraints.txt
lock:
	rm -rf .venv-lock
	$(PYTHON) -m venv .venv-lock
	.venv-lock/bin/pip install --quiet --disable-pip-version-check --editable '.[all,test,rapier]'
	(sed -n '/^#/p' constraints.txt; .venv-lock/bin/pip freeze --exclude-editable) > constraints.new
	mv constraints.new constraints.txt
	rm -rf .venv-lock

# into a folder outside of the project, since no file of others enters it
CORPORA ?= $(HOME)/.cache/simspec-corpora
corpora: setup
	$(BIN)/python tools/corpora --into $(CORPORA) --fetch --run --write

benchmarks: setup
	$(BIN)/python benchmarks/overhead.py
	$(BIN)/python benchmarks/compile.py
	$(BIN)/python benchmarks/scale.py

# the whole robot scenario; the study koerber-2021 is its sweep over timesteps
scenario-full: setup
	$(BIN)/simspec run specs/stack-cylinders.yaml --all-engines --no-repeats --deadline 3600

# random scenarios of the whole language, compiled, proven and run: none may be invalid; about 7 s each
COUNT ?= 200
random-worlds: setup
	$(BIN)/python tools/random_worlds.py --count $(COUNT)

# xacro, urdf, mjcf, sdf, usd, meshes, simspec; nothing may end but in an error with its place, or in a world
LANGUAGE ?= urdf
MINUTES ?= 10
fuzz: setup
	$(BIN)/python tools/fuzz --language $(LANGUAGE) --minutes $(MINUTES)

selftest: setup
	$(BIN)/python tools/selftest.py

# specs/*.yaml, specs/contact/*.yaml, specs/motion/*.yaml; the tests of every commit do a few of them
certify: setup
	SIMSPEC_CERTIFY=all $(BIN)/pytest -q -n $(JOBS) tests/proof/test_library_certified.py

# what tests/nightly.py leaves out at every commit; the tests there say what stands for it
slow: setup
	SIMSPEC_SLOW=all $(BIN)/pytest -q -n $(JOBS) --dist worksteal -m slow
	SIMSPEC_SLOW=all $(BIN)/pytest -q -n $(JOBS) --dist worksteal -m "not slow" tests/proof/test_verify.py
	$(BIN)/simspec pages --check $(PAGES)
	$(BIN)/simspec compile --check

nightly: setup
	$(BIN)/python tools/nightly.py

# nothing is lost, stray or left running, whenever a command is killed
kills: setup
	$(BIN)/python tools/kills.py
	$(BIN)/python tools/kill_sweeps.py

study-small: setup
	$(BIN)/simspec study koerber-2021 --small

study: setup
	$(BIN)/simspec study koerber-2021 --deadline 3600

# exit code 1 of the study: proofs fail at large timesteps, which is what its tables show
study-contact: setup
	$(BIN)/simspec study contact --deadline 3600 --publish docs/records/studies/contact || test $$? -eq 1
	$(BIN)/simspec pages docs/records/contact.md

site: setup
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	@echo build/site/index.html

# page/bundle is committed: only who changes page/src needs this; tests hold it against its sources
page-bundle:
	cd page && npm ci --no-audit --no-fund && npm run check && npm run build

clean:
	rm -rf .venv .venv-newest runs
