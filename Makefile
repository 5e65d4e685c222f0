# Everything is installed into .venv beside this file; `make` without a target lists the targets.

PYTHON ?= python3

ifdef ROS_DISTRO
# If ROS is sourced, it provides rclpy, and the wheels must not be installed.
venv_options := --system-site-packages
extras.demo := [studies]
extras.test := [test]
extras.benchmark := [peers]
else
# The wheels contain only Fast DDS; modules from elsewhere must not shadow theirs.
extras.demo := [ros,bag,studies]
extras.test := [ros,test]
extras.benchmark := [ros,peers]
unexport PYTHONPATH RMW_IMPLEMENTATION
ifdef _ROS_WHEELS_BOOTSTRAP_COMPLETE
# This shell was started by a Python with such wheels; do not inherit the path of its libraries.
unexport LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
endif
endif

# uv leaves it to the first import to compile a module: that is to be kept.
unexport PYTHONDONTWRITEBYTECODE

# A .venv is valid for one kind of ROS, one Python and one folder.
version := $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
kind := $(or $(ROS_DISTRO),wheels)-$(version)-$(firstword $(shell pwd | cksum))

# What installs in a third of pip's time; but it does not see the packages of a sourced ROS.
uv := $(if $(ROS_DISTRO),,$(shell uv --version >/dev/null 2>&1 && command -v uv))

python_has = $(shell $(PYTHON) -c 'import $(1)' >/dev/null 2>&1 && echo yes)
fault = $(or \
  $(if $(filter-out 3.10 3.11 3.12 3.13 3.14,$(or $(version),none)),\
    ca_ros needs Python 3.10 to 3.14 but $(PYTHON) is $(or $(version),not there): set PYTHON),\
  $(if $(uv)$(call python_has,ensurepip),,\
    $(PYTHON) cannot make a venv: apt install python$(version)-venv),\
  $(if $(filter-out jazzy kilted,$(ROS_DISTRO)),\
    ca_ros is for ROS 2 Jazzy and Kilted but ROS_DISTRO is $(ROS_DISTRO): use a shell without it),\
  $(if $(and $(ROS_DISTRO),$(if $(call python_has,rclpy),,no)),\
    ROS_DISTRO is $(ROS_DISTRO) but $(PYTHON) cannot import rclpy: source it or unset ROS_DISTRO),\
  $(if $(ROS_DISTRO)$(filter Linux_x86_64,$(shell uname -sm | tr ' ' _)),,\
    rclpy has wheels for x86-64 Linux only: install ROS 2 Jazzy here and source it))

# Tests of nodes wait for messages now and then: three for two processors.
workers = $(shell expr 3 "*" $$(nproc) / 2)

# The version with which `make compare` compares.
BASE ?= HEAD~1

# How long `make soak` keeps the nodes at 500 Hz [s].
SOAK ?= 600

.PHONY: explorer help demo test test-all test-fresh test-numpy soak benchmark compare readme docs venv clean

help:
	@echo 'make demo       fly the hexarotor over ROS 2 in real time; results in out/demo'
	@echo 'make test       lint, types and tests, in some minutes'
	@echo 'make test-all   the same tests in their long forms, those that take long, and the coverage'
	@echo 'make test-fresh what draws vehicles and wrenches, with a new random seed each time'
	@echo 'make test-numpy tests of allocation without the kernel in C'
	@echo 'make benchmark  time everything beside other solvers, for minutes; results in benchmarks'
	@echo 'make compare BASE=COMMIT   times and answers of HEAD beside those of another commit'
	@echo 'make soak       reliability in the long run, for half an hour or more; results in out/soak'
	@echo 'make readme     regenerate what the pages show: example, parameters, pictures'
	@echo 'make explorer   build the page of ca_ros explore; needs npm, clang and lld'
	@echo 'make docs       the pages and the API reference as HTML, in out/docs'
	@echo 'make venv       only set up .venv, with the rclpy of ROS 2 Jazzy'
	@echo 'make clean      remove .venv, out and all that builds and tests leave'
	@echo 'PYTHON=python3.12 and the like choose the Python, 3.10 to 3.14.'

demo: .venv/.demo
	.venv/bin/ca_ros bringup --method exact --mode realtime --out out/demo

test: .venv/.test
	.venv/bin/python -m ruff check
	.venv/bin/python -m mypy & \
	    .venv/bin/python -m pytest --numprocesses $(workers) --dist worksteal $(coverage) && wait $$!

test-all: export CA_ROS_LONG = 1
test-all: coverage = --cov ca_ros --cov-report term:skip-covered
page_tools := npm clang wasm-ld
test-all: $(if $(filter 3,$(words $(foreach tool,$(page_tools),$(shell command -v $(tool))))),\
    explorer .venv/.browser) .venv/.rotorpy test test-fresh
	.venv/bin/python docs/scripts/detection.py --hours 0.05

.venv/.browser: .venv/.test
	$(or $(uv),.venv/bin/uv) pip install -q --python .venv/bin/python -e '.[browser]' && touch $@

# For the flights of examples/rotorpy.
.venv/.rotorpy: .venv/.test
	$(or $(uv),.venv/bin/uv) pip install -q --python .venv/bin/python rotorpy==3.0.0 && touch $@

# What draws its vehicles and wrenches, with others each time; SEED=... repeats a run.
test-fresh: export CA_ROS_SEED := $(or $(SEED),$(shell date +%s))
test-fresh: .venv/.test
	@echo 'test-fresh: SEED=$(CA_ROS_SEED)'
	.venv/bin/python -m pytest --numprocesses $(workers) -m 'not slow' \
	    --hypothesis-seed $(CA_ROS_SEED) $$(grep -lE 'seeded\(|@given' test/test_*.py)

# What depends on the engine of `exact`, with the one that needs no compiler.
test-numpy: .venv/.test
	CA_ROS_KERNEL=numpy .venv/bin/python -m pytest --numprocesses auto -m 'not slow' \
	    $(patsubst %,test/test_%.py,admissible_set allocators conventional exact preference \
	    prioritize problem slew)

benchmark: .venv/.benchmark
	.venv/bin/python -m benchmarks --out benchmarks
	PYTHONPATH=. .venv/bin/python docs/scripts/performance.py

# In an environment without ROS, because asv passes its own environment on to those of the versions.
asv := out/compare/asv/bin
compare: $(asv)/asv
	PYTHONPATH=benchmarks $(asv)/python -m release.compare $(BASE) HEAD; answers=$$?; \
	$(asv)/asv machine --yes > out/compare/machine && \
	$(asv)/asv continuous --interleave-rounds --factor 1.1 $(BASE) HEAD && exit $$answers

$(asv)/asv:
	$(PYTHON) -m venv out/compare/asv
	$(asv)/python -m pip install -q --disable-pip-version-check asv==0.6.6 virtualenv numpy

soak: .venv/.test
	.venv/bin/python test/soak.py --seconds $(SOAK)

readme: demo
	.venv/bin/python docs/scripts/readme.py
	.venv/bin/ca_ros static_study --samples 1000 --seed 0 --out out/static
	cp out/static/slices.png out/static/violations.png docs
	.venv/bin/ca_ros attainable --fail 1 --out docs/attainable
	.venv/bin/python docs/scripts/model.py
	.venv/bin/python docs/scripts/failure.py
	.venv/bin/ca_ros dynamic_study --methods exact,pseudo_inverse,fixed_pseudo_inverse --fail 1@8 \
	    --duration 14 --out out/failure
	cp out/failure/failure.png docs
	.venv/bin/python docs/scripts/plant_effects.py
	.venv/bin/python docs/scripts/comparison.py
	.venv/bin/python docs/scripts/first_picture.py

explorer: ca_ros/explorer.html

ca_ros/explorer.html: $(wildcard explorer/*.* explorer/src/* ca_ros/kernel/*.[ch] config/*.yaml \
    ca_ros/explore.py ca_ros/settings.py ca_ros/*/*settings.py) | .venv/.demo
	@for tool in $(page_tools); do command -v $$tool >/dev/null || \
	    { echo "make explorer needs $$tool: apt install npm clang lld"; exit 1; }; done
	npm ci --silent --prefix explorer
	npm run --silent --prefix explorer build

docs: page = $(wildcard ca_ros/explorer.html)
docs: .venv/.test
	rm -rf out/docs out/docs-source
	mkdir -p out/docs-source/docs
	cp README.md CHANGELOG.rst out/docs-source
	cp -r docs/*.md docs/*.rst docs/*.png docs/*.gif docs/conf.py docs/static docs/templates out/docs-source/docs
	$(if $(page),sed -i 's#^!\[The explorer.*#<a href="explorer.html">&</a>#' out/docs-source/README.md)
	.venv/bin/python -m sphinx -q -W --keep-going -b html out/docs-source/docs out/docs
	$(if $(page),sed 's#^<title>#<meta name="pages" content="index.html">&#' $(page) > out/docs/explorer.html)
	@echo 'Written: out/docs/index.html'

venv: .venv/.demo
	@echo 'Ready: . .venv/bin/activate'

clean:
	rm -rf .venv out build dist install log *.egg-info
	rm -rf .coverage .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -prune -exec rm -rf {} +

# Lines of the output of uv and of pip to show: each package that is fetched, long steps, and errors.
steps := -e 's/^\(Collecting\|Downloading\) \([A-Za-z0-9._-]*\).*/  fetching \2/p' \
  -e 's/^Processing .*\/\([A-Za-z0-9._]*\)-.*\.whl.*/  fetching \1/p' \
  -e 's/^ *Building \([a-z][a-z-]*\) @.*/  building \1/p' \
  -e 's/^\(Resolved\|Prepared\|Installed\) /  \l&/p' \
  -e 's/^Installing collected packages:.*/  installing them all (half a minute or more)/p' \
  -e '/^ERROR/,$$p' -e '/^ *\(error:\|×\)/,$$p'

# Installers do not notice half-installed packages, so after an interruption all starts in a new venv.
.venv/.demo .venv/.test .venv/.benchmark: .venv/.$(kind) setup.py setup.cfg ca_ros_cli.py
	@echo 'Installing ca_ros and what it needs into .venv, which can take some minutes:'
	@rm $<
	@{ { $(or $(uv),.venv/bin/uv) pip install --python .venv/bin/python $(package) || \
	    .venv/bin/python -m pip install --progress-bar off $(package); } 2>&1 && \
	    touch $< .venv/.demo $@; } | sed -un $(steps)
	@test -e $<

package = -e '.$(extras$(suffix $@))'

.venv/.$(kind):
	$(if $(fault),$(error $(strip $(fault))))
	@rm -rf .venv
	@$(if $(uv),$(uv) venv -q --seed --python "$$($(PYTHON) -c 'import sys; print(sys.executable)')" .venv,\
	    $(PYTHON) -m venv $(venv_options) .venv)
	@$(if $(uv)$(ROS_DISTRO),,.venv/bin/python -m pip install -qq uv || true)
	@touch $@

.NOTPARALLEL:
