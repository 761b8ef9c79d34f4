#!/bin/sh
# Writes the comment of a comparison into the pull request (GitHub) or merge request (GitLab) of this job, or updates the one that it wrote
# before: action.yml and ci/gitlab.yml run it. A comment is no gate: where none can be written it says why, and its status is 0.
#   FATHOM_OUT      folder of the results, with comment.md [default: compare]
#   FATHOM_NAME     tells comments of several comparisons apart [default: compare]
#   FATHOM_TOKEN    may write comments: GitHub's job token; of GitLab an access token with the scope `api`, as the job token may not
#   FATHOM_LINK     where the whole result lies [default: the job's page]
#   FATHOM_AUTHOR   whose comments are updated [default: the token's user; of GitHub's job token `github-actions[bot]`]
set -eu

skip() {
    echo "note: no comment was written: $1" >&2
    exit 0
}
for tool in curl jq; do
    command -v "$tool" >/dev/null 2>&1 || skip "$tool is not installed"
done

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# METHOD URL [FILE]: `code` is the HTTP status, or 000, and the answer lies in a file. The token stays out of the command line.
ask() {
    code=$(curl --silent --show-error --max-time 60 --header "@$scratch/headers" --request "$1" ${3:+--data-binary "@$3"} \
        --output "$scratch/answer" --write-out '%{http_code}' "$2" 2>"$scratch/error") || code=000
}

# TYPE: the last answer was a good one, of this type of JSON.
good() {
    case $code in
    2??) jq -e --arg type "$1" 'type == $type' "$scratch/answer" >/dev/null 2>&1 || skip "the server's answer is no $1 of JSON" ;;
    000) skip "the server cannot be reached: $(head -n 1 "$scratch/error")" ;;
    401 | 403 | 404) skip "the server answered $code: the token may not write here, as in a request from a fork" ;;
    *) skip "the server answered $code" ;;
    esac
}

token=${FATHOM_TOKEN:-${CI_JOB_TOKEN:-}}
[ -n "$token" ] || skip "there is no token"
author=${FATHOM_AUTHOR:-}
if [ -n "${GITHUB_API_URL:-}" ]; then
    number=$(jq -r '.pull_request.number // empty' "${GITHUB_EVENT_PATH:-/dev/null}" 2>/dev/null) || number=""
    [ -n "$number" ] || skip "this job is not of a pull request"
    api=$GITHUB_API_URL/repos/${GITHUB_REPOSITORY:-}/issues
    all=$api/$number/comments one=$api/comments change=PATCH me=$GITHUB_API_URL/user
    authorization="Authorization: Bearer $token"
    link=${FATHOM_LINK:-${GITHUB_SERVER_URL:-}/${GITHUB_REPOSITORY:-}/actions/runs/${GITHUB_RUN_ID:-}}
elif [ -n "${CI_API_V4_URL:-}" ]; then
    [ -n "${CI_MERGE_REQUEST_IID:-}" ] || skip "this job is not of a merge request"
    all=$CI_API_V4_URL/projects/${CI_PROJECT_ID:-}/merge_requests/$CI_MERGE_REQUEST_IID/notes
    one=$all change=PUT me=$CI_API_V4_URL/user authorization="PRIVATE-TOKEN: $token"
    [ -n "${FATHOM_TOKEN:-}" ] || me=$CI_API_V4_URL/job authorization="JOB-TOKEN: $token"
    link=${FATHOM_LINK:-${CI_JOB_URL:-}/artifacts/browse/${FATHOM_OUT:-compare}}
else
    skip "this is neither a job of GitHub Actions nor of GitLab"
fi
printf '%s\nContent-Type: application/json\n' "$authorization" >"$scratch/headers"

if [ -z "$author" ]; then
    ask GET "$me"
    if [ "$code" = 403 ] && [ -n "${GITHUB_API_URL:-}" ]; then
        # GitHub's job token has no user.
        author="github-actions[bot]"
    else
        good object
        author=$(jq -r '[.login?, .username?, .user.username?] | map(strings) | .[0] // empty' "$scratch/answer")
        [ -n "$author" ] || skip "the server does not tell whose the token is"
    fi
fi

name=$(printf %s "${FATHOM_NAME:-compare}" | tr -c 'A-Za-z0-9._-' _)
mark="<!-- fathom compare: $name -->"
out=${FATHOM_OUT:-compare}
comment=$out/comment.md
# What lies there in the revision itself, or behind a link, no comparison has written.
if [ -L "$out" ] || [ -L "$comment" ] || [ -n "$(git ls-files -- "$out" 2>/dev/null)" ]; then comment=/dev/null; fi
{
    echo "$mark"
    if [ -s "$comment" ]; then cat "$comment"; else echo "### ⚠️ fathom compare: nothing was measured; the job's log has the reason"; fi
    echo "[Every cell and the records]($link)"
} >"$scratch/body"
jq -n --rawfile body "$scratch/body" '{body: $body}' >"$scratch/request"

# A comment of somebody else is left alone, even with the same mark.
page=1 found=""
while [ "$page" -le 50 ]; do
    ask GET "$all?per_page=100&page=$page"
    good array
    # shellcheck disable=SC2016
    found=$(jq -r --arg author "$author" --arg mark "$mark" '
        def is_ours: ([.user?, .author?] | map(.login?, .username?) | index($author)) and (.body | strings | startswith($mark));
        map(objects | select(is_ours)) | .[0].id // empty
    ' "$scratch/answer")
    if [ -n "$found" ] || [ "$(jq length "$scratch/answer")" -lt 100 ]; then break; fi
    page=$((page + 1))
done

if [ -n "$found" ]; then
    ask "$change" "$one/$found" "$scratch/request"
    done="updated"
else
    ask POST "$all" "$scratch/request"
    done="written"
fi
good object
echo "the comment was $done"
