#!/bin/sh
# Compares this checkout with its base, in a job of continuous integration: action.yml and ci/gitlab.yml run it. docs/ci.md has the statuses.
# All settings are variables; those that are empty are left to `fathom compare`.
#   FATHOM_BASE       revision to compare with, in the commit where it and HEAD part [default: the branch that the pull or merge request
#                     goes to; else FATHOM_BEFORE, the commit before a push, if it is there; else the first parent]
#   FATHOM_COMMAND    a simple command that starts a worker (docs/worker-protocol.md) in a checkout; without it fathom itself is compared
#   FATHOM_BUILD      commands that build a checkout before FATHOM_COMMAND
#   FATHOM_CELLS, FATHOM_CELLS_FILE, FATHOM_GATES, FATHOM_THRESHOLD, FATHOM_LAUNCHES, FATHOM_ADAPTER
#   FATHOM_FAIL_ON_INCONCLUSIVE   `true`: status 3 fails the job
#   FATHOM_OUT        folder of the results [default: compare]. What lies there before is set aside
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
    [ -z "${GITHUB_OUTPUT:-}" ] || {
        echo "status=${result:-2}"
        [ -z "${published:-}" ] || echo "results=$out"
    } >>"$GITHUB_OUTPUT"
    exit "$status"
}
trap finish EXIT

is_commit() { git rev-parse --verify --quiet --end-of-options "$1^{commit}"; }

# The branch of a pull request. A checkout may lack it, or its history; that of a fork has a branch of that name of its own.
fetch_target() {
    if [ "$(git rev-parse --is-shallow-repository)" = true ]; then git fetch --quiet --unshallow origin || true; fi
    if git fetch --quiet --no-tags "$GITHUB_SERVER_URL/$GITHUB_REPOSITORY" "refs/heads/$GITHUB_BASE_REF"; then
        git rev-parse FETCH_HEAD
    else
        echo "origin/$GITHUB_BASE_REF"
    fi
}

base=${FATHOM_BASE:-}
if [ -z "$base" ] && [ -n "${GITHUB_BASE_REF:-}" ]; then base=$(fetch_target); fi
# The first is there in a pipeline of merged results, whose HEAD is a merge; else GitLab names the commit where the branches part.
base=${base:-${CI_MERGE_REQUEST_TARGET_BRANCH_SHA:-${CI_MERGE_REQUEST_DIFF_BASE_SHA:-}}}
if [ -z "$base" ] && is_commit "${FATHOM_BEFORE:-}" >/dev/null; then base=$FATHOM_BEFORE; fi
base=${base:-HEAD^1}
if ! { revision=$(is_commit "$base") && revision=$(git merge-base "$revision" HEAD); }; then
    echo "error: there is no revision $base, or none where it and HEAD part: check out the whole history (GitHub: fetch-depth: 0; GitLab: GIT_DEPTH: 0)" >&2
    exit 2
fi

out=${FATHOM_OUT:-compare}
if [ -L "$out" ] || [ -n "$(git ls-files -- "$out")" ]; then
    echo "error: $out is a link or part of the revision: results need a folder of their own (FATHOM_OUT)" >&2
    exit 2
fi
# Of an earlier comparison, or of a build: nobody takes it for the results of this one.
set_aside() { if [ -e "$out" ]; then mv "$out" "$(mktemp -d "$out.before.XXXXXX")"; fi; }
set_aside
scratch=$(mktemp -d)
set -- compare "--out=$scratch/results"
[ -z "${FATHOM_CELLS:-}" ] || set -- "$@" "--cells=$FATHOM_CELLS"
[ -z "${FATHOM_CELLS_FILE:-}" ] || set -- "$@" "--cells-file=$FATHOM_CELLS_FILE"
[ -z "${FATHOM_GATES:-}" ] || set -- "$@" "--gates=$FATHOM_GATES"
[ -z "${FATHOM_THRESHOLD:-}" ] || set -- "$@" "--threshold=$FATHOM_THRESHOLD"
[ -z "${FATHOM_LAUNCHES:-}" ] || set -- "$@" "--launches=$FATHOM_LAUNCHES"
[ -z "${FATHOM_ADAPTER:-}" ] || set -- "$@" "--adapter=$FATHOM_ADAPTER"

if [ -n "${FATHOM_COMMAND:-}" ]; then
    git worktree add --quiet --detach "$scratch/base" "$revision"
    [ ! -e "$scratch/base/.gitmodules" ] || git -C "$scratch/base" submodule --quiet update --init --recursive
    FATHOM_BASE_CHECKOUT=$scratch/base FATHOM_HEAD_CHECKOUT=$PWD
    export FATHOM_BASE_CHECKOUT FATHOM_HEAD_CHECKOUT
    for checkout in "$FATHOM_BASE_CHECKOUT" "$FATHOM_HEAD_CHECKOUT"; do
        # No status of a build is one of a comparison.
        [ -z "${FATHOM_BUILD:-}" ] || (cd "$checkout" && sh -euc "$FATHOM_BUILD") || exit 2
    done
    if [ -n "${FATHOM_CELLS_FILE:-}" ] && [ -f "$FATHOM_BASE_CHECKOUT/$FATHOM_CELLS_FILE" ]; then
        set -- "$@" "--base-cells-file=$FATHOM_BASE_CHECKOUT/$FATHOM_CELLS_FILE"
    fi
    # `exec`: the worker itself is pinned to a core, and not a shell above it.
    # shellcheck disable=SC2016
    set -- "$@" '--base-cmd=cd "$FATHOM_BASE_CHECKOUT" && exec '"$FATHOM_COMMAND" \
        '--head-cmd=cd "$FATHOM_HEAD_CHECKOUT" && exec '"$FATHOM_COMMAND"
else
    set -- "$@" "--base=$revision"
fi

result=0
"$fathom" "$@" || result=$?
set_aside
if [ -d "$scratch/results" ]; then mv "$scratch/results" "$out" && published=true; fi
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
