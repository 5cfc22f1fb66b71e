# CTMC from a checkout. The targets set up what they need; `make PYTHON=/path/to/python3.13 ...` chooses the Python.
PYTHON ?=
# Any Python 3 can start the set-up; the set-up chooses the one for .venv.
starter := $(shell for python in '$(PYTHON)' python3 python3.13 python3.11; do command -v "$$python" && break; done)
python := .venv/bin/python

.PHONY: help setup demo test test-plain-processor fuzz test-all test-window test-package package lint types build address site bench accuracy interfaces segmentation topology experiments figures readme-pictures sidebar-pictures translations clean

help:  ## say what there is (this list)
	@sed -n 's/^\([a-z-]*\):[a-z ]*## */  make \1\t/p' Makefile | expand -t 18

setup:  ## make .venv with Blender as a module, the readers' libraries and the command ctmc
	@PYTHON='$(PYTHON)' '$(or $(starter),python3)' tools/setup_environment.py

demo: setup  ## phantom to tumor: files, reconstruction, picture and report in out/demo; CT=PATH: the same with a CT
	@$(python) tools/demo.py $(if $(CT),"$(CT)")

test: setup  ## the tests, in one Blender version, a process for each core; ARGS="-n 0" for one process
	@$(python) tools/run_tests.py $(ARGS)

test-all:  ## the tests in Blender 4.2, 4.5, 5.0 (Python 3.11) and 5.2 (Python 3.13); BLENDER=4.2 for one of them
	@'$(or $(starter),python3)' tools/test_all.py $(BLENDER)

test-plain-processor: setup  ## the tests of core and readers without the fast versions that NumPy chooses by the processor
	@$(python) tools/plain_processor.py $(ARGS)

fuzz: setup  ## changed files of every format, read with limits; SECONDS=600 SEED=7; Linux and macOS
	@OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests $(python) -W ignore -m fuzz $(ARGS)

test-window: setup  ## mouse and keys in real windows of Blender 4.3 and 5.2, pictures in out/window; needs root and debootstrap
	@$(python) tests/window/run.py $(ARGS)

package: setup  ## the Python package's wheel and source archive, in dist
	@$(python) -m build --outdir dist .

test-package: setup  ## that package in empty environments without Blender, in every Python from 3.11 to 3.14 that is there
	@$(python) tools/run_tests.py -n 0 -m packaging tests/packaging

lint: setup  ## ruff: rules and layout
	@.venv/bin/ruff check
	@.venv/bin/ruff format --check

types: setup  ## mypy, strict, as Linux, Windows and macOS are
	@.venv/bin/mypy
	@.venv/bin/mypy --platform win32 --cache-dir .mypy_cache/win32
	@.venv/bin/mypy --platform darwin --cache-dir .mypy_cache/darwin

build: setup  ## the extension's zips, one for each platform, in dist, with their sizes
	@$(python) tools/build_extension.py

address:  ## write where the project lives into manifest, package, citation and site: URL=https://host/owner/repository
	@'$(or $(starter),python3)' tools/set_address.py $(URL)

site: setup  ## the site of docs/, in out/site; every link, picture and anchor is checked; ARGS=--serve shows it while you edit
	@$(python) tools/make_site.py $(ARGS)

bench:  ## speed against VTK and others, in out/bench; ARGS="--quick --only extraction" for a part of it
	@'$(or $(starter),python3)' benchmarks/environment.py $(ARGS)

accuracy: setup  ## how near surfaces come to closed forms, of labels beside the peers': the tables of docs/development/accuracy.md
	@PYTHONPATH=tests $(python) -m benchmarks.accuracy $(ARGS)
	@'$(or $(starter),python3)' benchmarks/environment.py benchmarks.labels $(ARGS)

interfaces:  ## walls that labels share, ours and the peers'; LABELS=PATH:PATH for label volumes simplified together and alone
	@'$(or $(starter),python3)' benchmarks/environment.py benchmarks.shared_walls $(ARGS)

segmentation:  ## clicks to a Dice by a simulated user, ours and the peers'; ARGS="liver tumor --clicks 6" for some
	@'$(or $(starter),python3)' benchmarks/environment.py benchmarks.segmentation $(ARGS)

topology: setup  ## how often parts and Euler numbers are not the trilinear surface's; ARGS="100" for a hundred
	@PYTHONPATH=tests $(python) -m benchmarks.topology $(ARGS)

experiments: setup  ## the paper's tables on phantoms and a real CT, for docs/experiments.md; ARGS="--cases phantom-29"
	@$(python) tools/make_experiments.py $(ARGS)

figures: setup  ## the pictures of docs/figures.md, by the commands on that page
	@$(python) tools/make_figures.py $(ARGS)

readme-pictures: setup  ## the pictures of README, rendered from the CT of a chest: CT=FOLDER; a quarter of an hour
	@$(python) tools/make_readme_pictures.py "$(CT)" $(ARGS)

sidebar-pictures: setup  ## the pictures of docs/sidebar.md, of the phantom or CT=FOLDER, in a windowed Blender; needs what test-window needs
	@PYTHONPATH=tests $(python) -m window.sidebar_pictures $(if $(CT),--ct "$(CT)") $(ARGS)

translations: setup  ## list what the sidebar shows in English for want of a translation
	@PYTHONPATH=tests $(python) -m ui.strings_of_ours

clean:  ## remove what was made: environments, wheels, zips, outputs, caches
	rm -rf .venv .venvs build dist out wheels *.egg-info .pytest_cache .ruff_cache .mypy_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
