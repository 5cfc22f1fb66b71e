# CTMC from a checkout. The targets set up what they need; `make PYTHON=/path/to/python3.13 ...` chooses the Python.
PYTHON ?=
# Any Python 3 can start the set-up; the set-up chooses the one for .venv.
starter := $(shell for python in '$(PYTHON)' python3 python3.13 python3.11; do command -v "$$python" && break; done)
python := .venv/bin/python

.PHONY: help setup demo test test-plain-processor fuzz test-all test-window test-package package lint types types-linux types-win32 types-darwin build address site bench accuracy interfaces segmentation topology experiments figures readme-pictures sidebar-pictures translations clean

help:  ## list the targets
	@sed -n 's/^\([a-z-]*\):[a-z0-9 -]*## */  make \1\t/p' Makefile | expand -t 18

setup:  ## create .venv with Blender as a module, the readers' libraries and the command ctmc
	@PYTHON='$(PYTHON)' '$(or $(starter),python3)' tools/setup_environment.py

demo: setup  ## reconstruct a phantom's tumors, with files, picture and report in out/demo; CT=PATH to use a CT
	@$(python) tools/demo.py $(if $(CT),"$(CT)")

test: setup  ## run the tests in one Blender version, a process per core; ARGS="-n 0" for one process
	@$(python) tools/run_tests.py $(ARGS)

test-all:  ## run the tests in Blender 4.2, 4.5, 5.0 (Python 3.11) and 5.2 (Python 3.13); BLENDER=4.2 PART=core for some
	@'$(or $(starter),python3)' tools/test_all.py $(BLENDER) $(PART)

test-plain-processor: setup  ## run the tests of core and readers without NumPy's processor-specific code
	@$(python) tools/plain_processor.py $(ARGS)

fuzz: setup  ## read damaged files of every format within limits; SECONDS=600 SEED=7; Linux and macOS
	@OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests $(python) -W ignore -m fuzz $(ARGS)

test-window: setup  ## test mouse and keys in windows of Blender 4.3 and 5.2, pictures in out/window; needs root and debootstrap
	@$(python) tests/window/run.py $(ARGS)

package: setup  ## build the Python package's wheel and source archive in dist
	@$(python) -m build --outdir dist .

test-package: setup  ## test that package in empty environments without Blender, in each installed Python from 3.11 to 3.14
	@$(python) tools/run_tests.py -n 0 -m packaging tests/packaging

lint: setup  ## check rules and layout with ruff
	@.venv/bin/ruff check
	@.venv/bin/ruff format --check

types: types-linux types-win32 types-darwin  ## check types with mypy, strictly, for Linux, Windows and macOS

types-linux types-win32 types-darwin: types-%: setup
	@.venv/bin/mypy --platform $* --cache-dir .mypy_cache/$*

build: setup  ## build the extension's zips in dist, one per platform, and print their sizes
	@$(python) tools/build_extension.py

address:  ## write the project's address into manifest, package, citation and site; URL=https://host/owner/repository
	@'$(or $(starter),python3)' tools/set_address.py $(URL)

site: setup  ## build the site of docs/ in out/site and check links, pictures and anchors; ARGS=--serve to preview edits
	@$(python) tools/make_site.py $(ARGS)

bench:  ## measure speed against VTK and others, in out/bench; ARGS="--quick --only extraction" for a part
	@'$(or $(starter),python3)' benchmarks/environment.py $(ARGS)

accuracy: setup  ## measure errors against closed forms, and against peers for labels, for docs/development/accuracy.md
	@PYTHONPATH=tests $(python) -m benchmarks.accuracy $(ARGS)
	@'$(or $(starter),python3)' benchmarks/environment.py benchmarks.labels $(ARGS)

interfaces:  ## compare walls shared by labels with peers; LABELS=PATH:PATH to simplify label volumes jointly and one by one
	@'$(or $(starter),python3)' benchmarks/environment.py benchmarks.shared_walls $(ARGS)

segmentation:  ## count a simulated user's clicks to a Dice score, against peers; ARGS="liver tumor --clicks 6" for some cases
	@'$(or $(starter),python3)' benchmarks/environment.py benchmarks.segmentation $(ARGS)

topology: setup  ## count topology errors against the trilinear surface; ARGS="100" for a hundred grids
	@PYTHONPATH=tests $(python) -m benchmarks.topology $(ARGS)

experiments: setup  ## repeat the paper's tables on phantoms and a real CT, for docs/experiments.md; ARGS="--cases phantom-29"
	@$(python) tools/make_experiments.py $(ARGS)

figures: setup  ## render the pictures of docs/figures.md by the commands on that page
	@$(python) tools/make_figures.py $(ARGS)

readme-pictures: setup  ## render the pictures of README from the CT of a chest, in 15 minutes; CT=FOLDER
	@$(python) tools/make_readme_pictures.py "$(CT)" $(ARGS)

sidebar-pictures: setup  ## render the pictures of docs/sidebar.md in a windowed Blender, like test-window; CT=FOLDER instead of the phantom
	@PYTHONPATH=tests $(python) -m window.sidebar_pictures $(if $(CT),--ct "$(CT)") $(ARGS)

translations: setup  ## list the sidebar's texts without a translation
	@PYTHONPATH=tests $(python) -m ui.strings_of_ours

clean:  ## remove environments, wheels, zips, outputs and caches
	rm -rf .venv .venvs build dist out wheels *.egg-info .pytest_cache .ruff_cache .mypy_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
