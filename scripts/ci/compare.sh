#!/bin/sh
# Compares this checkout with its base, in a job of continuous integration: action.yml and ci/gitlab.yml run it. docs/ci.md has the statuses.
# All settings are variables; those that are empty are left to `fathom compare`.
#   FATHOM_BASE       revision to compare with [default: what the pull or merge request goes to; else the first parent]
#   FATHOM_COMMAND    a simple command that starts a worker (docs/worker-protocol.md) in a checkout; without it fathom itself is compared
#   FATHOM_BUILD      commands that build a checkout before FATHOM_COMMAND
#   FATHOM_CELLS, FATHOM_CELLS_FILE, FATHOM_GATES, FATHOM_THRESHOLD, FATHOM_LAUNCHES, FATHOM_ADAPTER
#   FATHOM_FAIL_ON_INCONCLUSIVE   `true`: status 3 fails the job
#   FATHOM_OUT        folder of the results [default: compare]
set -eu

home=$(CDPATH='' cd -- "$(dirname -- "$0")/../.." && pwd)
fathom=$home/target/release/fathom
scratch=""

# shellcheck disable=SC2317
finish() {
    status=$?
    [ -z "$scratch" ] || {
        git worktree remove --force "$scratch/base" 2>/dev/null || true
        rm -rf "$scratch"
    }
    [ -z "${GITHUB_OUTPUT:-}" ] || echo "status=${result:-2}" >>"$GITHUB_OUTPUT"
    exit "$status"
}
trap finish EXIT

base=${FATHOM_BASE:-}
# In a pipeline of merged results, as in a pull request of GitHub, HEAD is a merge, and its first parent the base.
if [ -z "$base" ] && [ "${CI_MERGE_REQUEST_EVENT_TYPE:-}" = detached ]; then
    base=${CI_MERGE_REQUEST_DIFF_BASE_SHA:-}
fi
base=${base:-HEAD^1}
revision=$(git rev-parse --verify --quiet --end-of-options "$base^{commit}") || {
    echo "error: there is no revision $base: check out the whole history (GitHub: fetch-depth: 0; GitLab: GIT_DEPTH: 0)" >&2
    exit 2
}

out=${FATHOM_OUT:-compare}
if [ -L "$out" ] || [ -n "$(git ls-files -- "$out")" ]; then
    echo "error: $out is a link or part of the revision: results need a folder of their own (FATHOM_OUT)" >&2
    exit 2
fi
set -- compare "--out=$out"
[ -z "${FATHOM_CELLS:-}" ] || set -- "$@" "--cells=$FATHOM_CELLS"
[ -z "${FATHOM_CELLS_FILE:-}" ] || set -- "$@" "--cells-file=$FATHOM_CELLS_FILE"
[ -z "${FATHOM_GATES:-}" ] || set -- "$@" "--gates=$FATHOM_GATES"
[ -z "${FATHOM_THRESHOLD:-}" ] || set -- "$@" "--threshold=$FATHOM_THRESHOLD"
[ -z "${FATHOM_LAUNCHES:-}" ] || set -- "$@" "--launches=$FATHOM_LAUNCHES"
[ -z "${FATHOM_ADAPTER:-}" ] || set -- "$@" "--adapter=$FATHOM_ADAPTER"

if [ -n "${FATHOM_COMMAND:-}" ]; then
    scratch=$(mktemp -d)
    git worktree add --quiet --detach "$scratch/base" "$revision"
    [ ! -e "$scratch/base/.gitmodules" ] || git -C "$scratch/base" submodule --quiet update --init --recursive
    FATHOM_BASE_CHECKOUT=$scratch/base FATHOM_HEAD_CHECKOUT=$PWD
    export FATHOM_BASE_CHECKOUT FATHOM_HEAD_CHECKOUT
    for checkout in "$FATHOM_BASE_CHECKOUT" "$FATHOM_HEAD_CHECKOUT"; do
        [ -z "${FATHOM_BUILD:-}" ] || (cd "$checkout" && sh -euc "$FATHOM_BUILD")
    done
    # `exec`: the worker itself is pinned to a core, and not a shell above it.
    # shellcheck disable=SC2016
    set -- "$@" '--base-cmd=cd "$FATHOM_BASE_CHECKOUT" && exec '"$FATHOM_COMMAND" \
        '--head-cmd=cd "$FATHOM_HEAD_CHECKOUT" && exec '"$FATHOM_COMMAND"
else
    set -- "$@" "--base=$revision"
fi

result=0
"$fathom" "$@" || result=$?
case $result in
3)
    [ "${FATHOM_FAIL_ON_INCONCLUSIVE:-false}" != true ] || exit 1
    echo "note: inconclusive: no slowdown was found, but some cells were too noisy to rule one out" >&2
    # GitLab shows a job that ends with a status that is allowed to fail as a warning; GitHub has no such thing.
    if [ -n "${GITLAB_CI:-}" ]; then exit 3; fi
    exit 0
    ;;
*) exit "$result" ;;
esac
