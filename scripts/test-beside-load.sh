#!/bin/sh
# Runs the tests beside as many busy processes as there are cores, and returns their status: no result of a test may depend on
# what else the machine does. With arguments it runs that command in place of `make test`.
set -u
cd "$(dirname "$0")/.."
[ $# -gt 0 ] || set -- make test

busy=
trap 'kill $busy 2>/dev/null' EXIT
trap 'exit 130' INT
trap 'exit 143' TERM
for _ in $(seq "$(getconf _NPROCESSORS_ONLN)"); do
    (while :; do :; done) &
    busy="$busy $!"
done

"$@"
