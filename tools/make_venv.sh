#!/bin/sh
# Make a virtual environment with pip. Debian keeps the module that does it in a package of its own,
# python3-venv; where that is missing, use what else is there, or say what to install.
set -eu
python=$1
venv=$2

if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
    echo "dense-vs needs Python 3.11 or newer; '$python' is $("$python" --version 2>&1 || true)" >&2
    exit 1
fi
if "$python" -c 'import ensurepip, venv' 2>/dev/null; then
    exec "$python" -m venv "$venv"
fi
if command -v uv >/dev/null; then
    exec uv venv --quiet --seed --python "$python" "$venv"
fi
if "$python" -m virtualenv --version >/dev/null 2>&1; then
    exec "$python" -m virtualenv --quiet "$venv"
fi
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "installing python3-venv, which Debian leaves out of python3"
    apt-get -qq update && apt-get -qq install -y python3-venv >/dev/null
    exec "$python" -m venv "$venv"
fi
echo "Python's venv module is missing; on Debian: sudo apt install python3-venv" >&2
exit 1
