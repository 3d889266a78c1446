# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0

# The commands of this project; `make help` lists them. Each creates the virtual environment it
# needs on first use and finds it ready the next time.
#
# PYTHON  interpreter that creates the environment (3.10 or later)
# VENV    where the environment lives
PYTHON ?= python3
ifdef ROS_DISTRO
# A ROS installation is sourced: take rclpy and the messages from it, the rest from the index.
VENV ?= .venv-$(ROS_DISTRO)
VENV_OPTIONS := --system-site-packages
REQUIREMENTS := grep -v '^ros-' requirements.txt
NO_RCLPY := the sourced ROS installation has none for this Python; name its own: PYTHON=...
else
VENV ?= .venv
VENV_OPTIONS :=
REQUIREMENTS := cat requirements.txt
NO_RCLPY := wheels exist for Linux on x86-64 only; elsewhere source a ROS 2 installation first
endif

RUN = "$(VENV)/bin/python"
# What is installed is written down in the environment itself, to be compared next time.
INSTALLED = $(VENV)/installed-requirements.txt

.PHONY: installed formats archive docs docs-libraries lint-libraries docs-links drawings help demo test test-quick lint processors aarch64 fault-campaign mutation-campaign autofocus-campaign mistakes doctor-campaign bags reproduce-multichannel reproduce-spotlight-letter release-check matrix coverage colcon environment clean prediction-campaign simulator obstacle-campaign obstacle-shadows localization-campaign localization-demo format-campaign cphd-memory archive-campaign gpu gpu-tests gpu-benchmark gpu-roofline benchmark-robots
QUICK_TESTS := test/msg_conversions test/geometry test/signal test/planning test/imaging/test_goldens.py test/imaging/test_image.py test/test_package.py
.DEFAULT_GOAL := help

help:
	@echo 'make demo    replay bags/countryside through the ROS 2 nodes into out/demo'
	@echo 'make test    ruff, then every test, real nodes over real DDS among them'
	@echo 'make test-quick'
	@echo '             the core alone, a minute once its kernels are compiled'
	@echo 'make lint    ruff, and types by mypy where NumPy is $(TYPED_NUMPY)'
	@echo 'make processors'
	@echo '             kernel tests and pinned images with the code of AVX2 and of a generic processor,'
	@echo '             three minutes'
	@echo 'make aarch64 images on an emulated aarch64 beside the pinned ones, on Debian; half an hour'
	@echo 'make fault-campaign'
	@echo '             twenty rounds of faults at random moments, an hour or two; FAULT_ROUNDS=2 for few'
	@echo 'make mutation-campaign'
	@echo '             random mistakes in the code: which do the tests notice? Two hours;'
	@echo '             MUTATIONS=20 MUTATION_SEED=2 MUTATION_FOLDERS="signal geometry" for few'
	@echo 'make autofocus-campaign'
	@echo '             200 random drone flights with wrong clocks, and recordings through node processes;'
	@echo '             an hour; FLIGHTS=20 for few, DATA=folder of the rail recordings'
	@echo 'make mistakes'
	@echo '             twenty mistakes injected into right recordings: which are named; some minutes'
	@echo 'make doctor-campaign'
	@echo '             22 faults injected into 100 random recordings each, and into measured ones: which are named;'
	@echo '             an hour or more, goes on where it was stopped, CASES=10 for few'
	@echo 'make drivers radar_driver with the messages of five drivers over DDS; builds these with a C++'
	@echo '             compiler, a minute or two'
	@echo 'make prediction-campaign'
	@echo '             images of 1,500 random geometries beside their predicted errors, some 15 minutes of a core;'
	@echo '             goes on where it was stopped, CASES=100 for few'
	@echo 'make obstacle-shadows'
	@echo '             what obstacle maps call free behind walls and beside them, 100 scenes, 10 minutes of a core; SCENES=10 for few'
	@echo 'make benchmark-robots'
	@echo '             images near the antenna, beside FastSAR where FASTSAR names a Python that has it, 10 minutes'
	@echo 'make obstacle-campaign'
	@echo '             obstacle maps of 300 random scenes beside the truth, 15 minutes of a core; SCENES=10 for few'
	@echo 'make localization-campaign'
	@echo '             images found in reference maps: simulated revisits, absent places, measured passes; 15 minutes of a core'
	@echo 'make localization-demo'
	@echo '             a car drives a loop of 1 km twice, the map of the first round locates it in the second;'
	@echo '             out/localization_demo.png and .g2o, two minutes of a core'
	@echo 'make format-campaign'
	@echo '             10,000 damaged files for each reader of formats; every reader and every output with hostile'
	@echo '             files and places, results in benchmarks/results; half an hour'
	@echo 'make archive-campaign'
	@echo '             archives by 1, 2 and 4 workers and in two network namespaces; their workers, or all'
	@echo '             processes, killed at random moments, 20 times each; half an hour'
	@echo 'make simulator'
	@echo '             every test of the CUDA backend in a simulator of a device, half a minute'
	@echo 'make gpu     on a machine with an NVIDIA device and the extra cuda: tests of its kernels and images, the same'
	@echo '             under compute-sanitizer, rates and errors, rooflines; PYTHON of the device, half an hour at most'
	@echo 'make cphd-memory'
	@echo '             a CPHD file of 4 GB, written and imaged within 2 GB of memory, ten minutes; BYTES=1e9 for a small one'
	@echo 'make bags    write the recordings in bags/ again'
	@echo 'make reproduce-multichannel'
	@echo '             figures and tables of Rosenberg & Gray into out/multichannel'
	@echo 'make reproduce-spotlight-letter'
	@echo '             figures and numbers of Zhang et al., AFBP and FFBP, into out/spotlight_letter'
	@echo 'make colcon  build and start the package as a ROS workspace does, in build/colcon'
	@echo 'make environment'
	@echo '             the virtual environment alone; its Python imports the package from anywhere'
	@echo 'make formats the libraries that read and write CPHD, SICD and GeoTIFF, into that environment'
	@echo 'make archive Dask and Zarr besides, which image archives of many recordings'
	@echo 'make docs    the documentation site into build/docs/html, in an environment of its own; warnings are errors'
	@echo 'make docs-links'
	@echo '             do the addresses outside the site still answer? Needs the network'
	@echo 'make drawings'
	@echo '             draw the mermaid blocks of the pages again that were changed; needs npx and Chromium'
	@echo 'make release-check'
	@echo '             whether this version may be published: version, changelog, addresses; wheel and source'
	@echo '             distribution built, checked, installed and tested'
	@echo '             debian package built, installed into an empty root and started; keys of package.xml, with'
	@echo '             ROSDISTRO=checkout of github.com/ros/rosdistro; container; what cannot run here is listed'
	@echo 'make matrix  the core with each Python from 3.10 to 3.14 that is here, with NumPy 1.26 and 2; says which is not'
	@echo 'make coverage'
	@echo '             lines and branches that the tests execute, half an hour; fails below what was reached'
	@echo 'make clean   remove what these commands made, the environment excepted'
	@echo 'Variables: PYTHON=python3.12 (interpreter), VENV=path (environment)'

demo: environment
	@echo 'Replaying bags/countryside through pulse_buffer, range_compression and backprojection ...'
	@$(RUN) -m sar_imaging.tools.evaluate bags/countryside --output out/demo --launch-nodes

# The tests' bytecode is kept even if the shell wants none: four processes read the same files.
test test-quick: export PYTHONDONTWRITEBYTECODE =
test: lint docs-libraries
	@echo 'pytest, in four processes ...'
	@$(RUN) -m pytest -n 4 --dist loadfile --no-loadscope-reorder

# What the hand that edits wants to know at once: conversions, geometry, signals, plans, pinned images.
test-quick: environment
	@$(RUN) -m pytest -x -n 2 --dist loadfile $(QUICK_TESTS)

# Each NumPy states types of its own, of which those before 2.3 do not suit the settings.
TYPED_NUMPY = 2.4
lint: lint-libraries
	@echo 'ruff check ...'
	@$(RUN) -m ruff check .
	@if $(RUN) -c 'import numpy, sys; sys.exit(not numpy.__version__.startswith("$(TYPED_NUMPY)."))'; then \
	echo 'mypy ...'; $(RUN) -m mypy; \
	else echo 'types are not checked: they are with NumPy $(TYPED_NUMPY)'; fi

# What a version needs before it is published, see docs/releasing.md.
# What cannot be checked here is told as skipped.
release-check: lint-libraries
	@$(RUN) -c 'import build, twine, rattler_build, spellchecker' 2>/dev/null || \
	    $(RUN) -m pip install --quiet --disable-pip-version-check -r requirements-release.txt
	@failed=0; $(RUN) -m pytest -m release test/test_package.py test/test_distribution.py \
	    test/docs/test_spelling.py || failed=1; \
	$(RUN) -m benchmarks.release.check $(if $(ROSDISTRO),--rosdistro "$(ROSDISTRO)") || failed=1; \
	exit $$failed

# An environment of its own for each Python, and a part of the tests in it.
matrix:
	@$(PYTHON) -m benchmarks.release.matrix

# Compiled loops are no lines that Python executes; node processes are counted, too.
coverage: archive
	@$(RUN) -m pip install --quiet --disable-pip-version-check coverage==7.17.3
	@$(RUN) -m benchmarks.release.coverage

# The suite takes a part of this.
processors: environment
	@$(RUN) -m pytest -m campaign test/backends/test_processors.py

# With the interpreter that has CuPy and numba-cuda. Each of the three parts ends within ten
# minutes. Results go to benchmarks/results/gpu.json and build/gpu-roofline.txt.
GPU_TESTS = -m pytest -m '' -p no:cacheprovider test/backends/cuda
SANITIZER = timeout 160 compute-sanitizer --error-exitcode 9 --tool
WITHOUT_LONG = -k 'not measured_costs and not benchmark'
NCU = timeout 240 ncu --set roofline --kernel-name-base demangled --launch-skip 2 --launch-count 20
gpu: gpu-tests gpu-benchmark gpu-roofline

simulator: environment
	@NUMBA_ENABLE_CUDASIM=1 $(RUN) $(GPU_TESTS)

gpu-tests:
	timeout 100 $(PYTHON) -m pytest -p no:cacheprovider test/backends/test_cuda_compiles.py
	timeout 170 $(PYTHON) $(GPU_TESTS)
	timeout 170 $(PYTHON) -m pytest -p no:cacheprovider test/backends/test_reference_backend.py -k cuda
	$(SANITIZER) memcheck --report-api-errors no $(PYTHON) $(GPU_TESTS) $(WITHOUT_LONG)
	$(SANITIZER) racecheck $(PYTHON) $(GPU_TESTS) $(WITHOUT_LONG)

gpu-benchmark:
	timeout 590 $(PYTHON) -m benchmarks.gpu

gpu-roofline:
	mkdir -p build
	$(NCU) $(PYTHON) -m benchmarks.gpu --case 4096 > build/gpu-roofline.txt
	$(NCU) $(PYTHON) -m benchmarks.gpu --case 'AFBP 4096' >> build/gpu-roofline.txt

# Results go to benchmarks/results; what is fetched lies in build/aarch64.
aarch64: environment
	@$(RUN) -m benchmarks.aarch64

# FAULT_SEED and FAULT_ROUNDS choose the random numbers; a failed test's name has its seed.
fault-campaign: environment
	@FAULT_SEED=$${FAULT_SEED:-$$(date +%s)} FAULT_ROUNDS=$${FAULT_ROUNDS:-20} \
	    $(RUN) -m pytest -m campaign test/nodes/faults/test_fault_campaign.py
	@CAUSES_RESULTS=benchmarks/results/causes.json \
	    $(RUN) -m pytest -m '' test/nodes/faults/test_causes.py

# cosmic-ray and coverage live in an environment of their own. Which test executes what is measured
# once, in a quarter of an hour; remove build/mutation/work to have it measured anew. A campaign
# that was stopped goes on; another sample needs other MUTATION_RESULTS.
MUTATION = build/mutation
MUTATIONS ?= 310
MUTATION_SEED ?= 17
MUTATION_FOLDERS ?= signal geometry autofocus exploitation quality configuration simulation \
    diagnosis msg_conversions planning backends imaging streaming nodes formats loading radiometry tools
MUTATION_RESULTS ?= $(MUTATION)/mutations.json

mutation-campaign:
	@$(MAKE) --no-print-directory installed VENV=$(MUTATION)
	@$(MUTATION)/bin/python -m pip install --quiet --disable-pip-version-check \
	    cosmic-ray==8.7.0 coverage==7.17.3
	@test -e $(MUTATION)/work/coverage || $(MUTATION)/bin/python -m benchmarks.mutations measure
	@$(MUTATION)/bin/python -m benchmarks.mutations --results $(MUTATION_RESULTS) run \
	    --count $(MUTATIONS) --seed $(MUTATION_SEED) --folders $(MUTATION_FOLDERS)

# Results go to benchmarks/results; other flights than those of the documents with SEED.
autofocus-campaign: environment
	@$(RUN) -m benchmarks.autofocus_flights --flights $${FLIGHTS:-200} --first $${SEED:-62117}
	@$(RUN) -m benchmarks.autofocus_flights --widths --flights 6 --first 80000
	@$(RUN) -m benchmarks.autofocus_flights --out-of-reach --flights 60 --first 63000
	@$(RUN) -m benchmarks.autofocus_flights --rails $${DATA:-../shared/data}
	@$(RUN) -m benchmarks.autofocus_nodes $${DATA:-../shared/data}

mistakes: environment
	@$(RUN) -m benchmarks.mistakes

# Results go to benchmarks/results.
doctor-campaign: environment
	@$(RUN) -m benchmarks.doctor --cases $${CASES:-100}

# The generators come with the ROS wheels.
drivers: environment
	@$(RUN) -m pytest -m compiler test/nodes

# Every case follows from its seed; what is measured lies in out/prediction_campaign.jsonl.
prediction-campaign: environment
	@$(RUN) -m benchmarks.prediction_campaign --cases $${CASES:-1500}

# Results go to benchmarks/results. FASTSAR names a Python that has FastSAR, beside which to measure.
benchmark-robots: environment
	@OMP_NUM_THREADS=1 JAX_PLATFORMS=cpu $${FASTSAR:-$(RUN)} -m benchmarks.robots

# Results go to benchmarks/results, unless RESULTS names another file.
obstacle-shadows: environment
	@$(RUN) -m benchmarks.obstacle_shadows --scenes $${SCENES:-100} \
	    --results $${RESULTS:-benchmarks/results/obstacle_shadows.json}

obstacle-campaign: environment
	@$(RUN) -m benchmarks.obstacle_campaign --scenes $${SCENES:-100} \
	    --results $${RESULTS:-benchmarks/results/obstacles.json}

# Seeds are fresh; measured data lie in ../shared/data.
localization-campaign: environment
	@$(RUN) -m benchmarks.localization

localization-demo: environment
	@$(RUN) -m benchmarks.localization_drive

format-campaign: formats
	@$(RUN) -m pytest -m campaign test/formats

# Results of real pieces go to benchmarks/results.
archive-campaign: archive
	@ARCHIVE_RESULTS=benchmarks/results/archive_campaign.json \
	    $(RUN) -m pytest -m campaign test/archive test/docs

# Results go to benchmarks/results; the file lies in out/ meanwhile, and samples that wait beside it.
cphd-memory: formats
	@$(RUN) -m benchmarks.cphd_memory --bytes $${BYTES:-4e9}

# The commands of bags/README.md.
bags: environment
	@$(RUN) -m sar_imaging.tools.simulate psf --output bags/psf \
	    --pulses-per-message 25 --force
	@$(RUN) -m sar_imaging.tools.simulate spotlight --output bags/spotlight \
	    --pulses-per-message 16 --force
	@$(RUN) -m sar_imaging.tools.simulate countryside --output bags/countryside \
	    --pulses-per-message 24 --force

reproduce-multichannel: environment
	@$(RUN) -m benchmarks.reproduction.reproduce_multichannel --output out/multichannel

reproduce-spotlight-letter: environment
	@$(RUN) -m benchmarks.reproduction.reproduce_spotlight_letter --output out/spotlight_letter

# colcon runs in an environment of its own: installed executables start with the Python that ran
# it, and its pytest plug-ins should not change how the tests run elsewhere.
COLCON = build/colcon

colcon:
	@$(MAKE) --no-print-directory installed VENV=$(COLCON)
	@$(COLCON)/bin/python -m pip install --quiet --disable-pip-version-check \
	    colcon-common-extensions==0.3.0
	@echo 'colcon build, copied and linked, and every executable ...'
	@$(COLCON)/bin/python -m pytest test/test_colcon.py

# What pip would install as `sar-imaging`, by the Python beside it: shell and Python read it alike.
PROGRAM = '\#!/bin/sh' "'''exec' \"\$$(dirname \"\$$0\")/python\" \"\$$0\" \"\$$@\"" "' '''" \
    'import sys' 'from sar_imaging.tools.command import main' 'sys.exit(main())'

# The path from the environment to the checkout, so that both may be moved together, makes the
# package importable from anywhere.
environment: installed
	@$(RUN) -c 'import os, pathlib, sysconfig; site = sysconfig.get_path("purelib"); \
	    file = pathlib.Path(site, "sar_imaging.pth"); line = os.path.relpath(os.getcwd(), site) + "\n"; \
	    file.exists() and file.read_text() == line or file.write_text(line)'
	@test -x "$(VENV)/bin/sar-imaging" || { printf '%s\n' $(PROGRAM) > "$(VENV)/bin/sar-imaging" && \
	    chmod +x "$(VENV)/bin/sar-imaging"; }

# Libraries of file formats: what `pip install sar_imaging[formats]` installs, and what checks it.
# NumPy stays as it is, for ROS installations bring one that their messages are compiled for.
formats: environment
	@if cmp -s requirements-formats.txt "$(VENV)/installed-formats.txt"; then exit 0; fi; \
	echo 'Installing libraries of file formats into $(VENV), once ...' && \
	$(RUN) -m pip install --quiet --disable-pip-version-check -r requirements-formats.txt \
	    "numpy==$$($(RUN) -c 'import numpy; print(numpy.__version__)')" && \
	cp requirements-formats.txt "$(VENV)/installed-formats.txt"

# Dask and Zarr: what `pip install sar_imaging[archive]` installs besides.
archive: formats
	@if cmp -s requirements-archive.txt "$(VENV)/installed-archive.txt"; then exit 0; fi; \
	echo 'Installing Dask and Zarr into $(VENV), once ...' && \
	$(RUN) -m pip install --quiet --disable-pip-version-check -r requirements-archive.txt \
	    "numpy==$$($(RUN) -c 'import numpy; print(numpy.__version__)')" && \
	cp requirements-archive.txt "$(VENV)/installed-archive.txt"

# The type checker: what `pip install sar_imaging[lint]` installs.
lint-libraries: environment
	@if cmp -s requirements-lint.txt "$(VENV)/installed-lint.txt"; then exit 0; fi; \
	echo 'Installing the type checker into $(VENV), once ...' && \
	$(RUN) -m pip install --quiet --disable-pip-version-check -r requirements-lint.txt && \
	cp requirements-lint.txt "$(VENV)/installed-lint.txt"

# Sphinx: what `pip install sar_imaging[docs]` installs.
docs-libraries: archive
	@if cmp -s requirements-docs.txt "$(VENV)/installed-docs.txt"; then exit 0; fi; \
	echo 'Installing Sphinx into $(VENV), once ...' && \
	$(RUN) -m pip install --quiet --disable-pip-version-check -r requirements-docs.txt && \
	cp requirements-docs.txt "$(VENV)/installed-docs.txt"

# The examples of the gallery run when the site is built, hence all libraries. What Sphinx makes of
# docstrings and examples lies in docs/ meanwhile, where git does not see it.
DOCS = build/docs-environment
SPHINX = $(DOCS)/bin/python -m sphinx -j 2 -d build/docs/doctrees

docs:
	@$(MAKE) --no-print-directory docs-libraries VENV=$(DOCS)
	@rm -rf docs/api/generated build/docs/html  # pages of names that are gone
	@$(SPHINX) -q -W --keep-going -b html docs build/docs/html
	@echo 'The site is in build/docs/html/index.html'

docs-links:
	@$(MAKE) --no-print-directory docs-libraries VENV=$(DOCS)
	@$(SPHINX) -q -b linkcheck docs build/docs/links

drawings:
	@$(MAKE) --no-print-directory docs-libraries VENV=$(DOCS)
	@$(DOCS)/bin/python docs/extensions/draw.py

# Colcon and the mutation campaign bring copies of the package of their own.
installed:
	@if $(RUN) -c 'import rclpy' 2>/dev/null && $(REQUIREMENTS) | cmp -s - "$(INSTALLED)"; then exit 0; fi; \
	"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null || { \
	    echo 'Python 3.10 or later is needed, but PYTHON=$(PYTHON) is:' \
	         "$$("$(PYTHON)" --version 2>&1 || true)" >&2; \
	    echo 'Install one and name it: make PYTHON=python3.12 ...' >&2; exit 1; }; \
	"$(PYTHON)" -c 'import ensurepip, venv' 2>/dev/null || { \
	    echo '$(PYTHON) cannot create virtual environments.' \
	         'On Debian and Ubuntu: sudo apt install python3-venv' >&2; exit 1; }; \
	echo 'Installing into $(VENV), once ...' && \
	"$(PYTHON)" -m venv $(VENV_OPTIONS) "$(VENV)" && \
	$(REQUIREMENTS) > "$(VENV)/requirements.txt" && \
	$(RUN) -m pip install --quiet --disable-pip-version-check -r "$(VENV)/requirements.txt" && \
	{ $(RUN) -c 'import rclpy' || { echo 'No rclpy: $(NO_RCLPY)' >&2; exit 1; }; } && \
	mv "$(VENV)/requirements.txt" "$(INSTALLED)" && echo 'Environment ready.'

clean:
	rm -rf out build install log *.egg-info .pytest_cache .ruff_cache .hypothesis docs/api/generated docs/auto_examples
	find sar_imaging msg_conversions test benchmarks -name __pycache__ -prune -exec rm -rf {} +
