#!/usr/bin/env bash
# install.sh ENVIRONMENT SIMSPEC [PACKAGE...]: install simspec, editable ('.[extra]'), and other packages into an environment, at the
# versions of constraints.txt. By uv, which pip installs first (UV: that of another environment): a sixth of pip's processor time
# for the same packages (17 s and 100 s, measured). By pip where uv cannot be had, or fails.
# Neither compiles modules: most are never imported, and Python compiles the others when they are.
set -euo pipefail
constraints=$(cd "$(dirname "$0")/.." && pwd)/constraints.txt
place=$1
shift
pip_install() {
  "$place/bin/python" -m pip --version >/dev/null 2>&1 || "$place/bin/python" -m ensurepip >/dev/null
  PIP_CONSTRAINT=$constraints "$place/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile "$@"
}
by_uv() {
  local uv=${UV:-$place/bin/uv}
  if [ ! -x "$uv" ]; then
    pip_install uv || return 1
    uv=$place/bin/uv
  fi
  UV_CONSTRAINT=$constraints UV_BUILD_CONSTRAINT=$constraints "$uv" pip install --quiet --python "$place/bin/python" --editable "$@"
}
by_uv "$@" || {
  echo "uv did not install the packages: pip does" >&2
  pip_install --editable "$@"
}
