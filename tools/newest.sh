#!/usr/bin/env bash
# The newest Python for which engines have wheels, where it is installed: simspec with two engines in a separate
# environment, a first run, and tests that need no other engine. PyBullet's wheels end at Python 3.11, which `make test` uses.
set -euo pipefail
cd "$(dirname "$0")/.."
python=""
for version in 3.13 3.12; do
  for name in "python$version" "${PYENV_ROOT:-$HOME/.pyenv}/versions/$version".*/bin/python; do
    # a name may be a link to a version manager that does not have the version
    if [ -z "$python" ] && "$name" -c 'import venv' 2>/dev/null; then python=$name; fi
  done
done
if [ -z "$python" ]; then
  echo "no Python 3.13 or 3.12 is installed: simspec is not tested on a newer Python than 3.11"
  exit 0
fi
"$python" --version
place=.venv-newest
# without pip, whose installation takes 3 s; tools/install.sh installs it where it has to
[ -x "$place/bin/simspec" ] || "$python" -m venv --clear --without-pip "$place"
UV=$PWD/.venv/bin/uv tools/install.sh "$place" '.[mujoco,dart,testing]' hypothesis jsonschema lxml pint syrupy
program=$PWD/$place/bin/simspec
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
(cd "$folder" && "$program" new pendulum && "$program" run pendulum.yaml -e mujoco -e dart --quick)
"$place/bin/pytest" -q -p no:cacheprovider tests/language/test_schema.py tests/language/test_units.py tests/language/test_load.py \
  tests/commands/test_completion.py tests/engines/mujoco/test_engine.py
