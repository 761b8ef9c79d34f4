#!/bin/sh
# Checks the licence of every crate that fathom is built or tested with, on any system and with any feature: an expression must hold
# with the licences below alone. Prints the crates that fail and ends with status 1.
set -euf
cd "$(dirname "$0")/.."

allowed="MIT MIT-0 Apache-2.0 BSD-2-Clause BSD-3-Clause ISC Zlib 0BSD Unicode-3.0 CDLA-Permissive-2.0"

for workspace in . examples/vello_frames; do
    cargo tree --quiet --locked --manifest-path $workspace/Cargo.toml --workspace --all-features --target all --prefix none --format '{l}|{p}'
done |
    sed 's/ (\*)$//' | sort -u | grep -v '^$' |
    awk -F '|' -v allowed="$allowed" '
        # One of the licences of an "or" is allowed. Exceptions allow more, so "Apache-2.0 WITH ..." is Apache-2.0.
        function one_of(terms,    list, n, i) {
            gsub(/[()]/, "", terms)
            gsub(/ WITH [^ ]+/, "", terms)
            n = split(terms, list, / OR | ?\/ ?/)
            for (i = 1; i <= n; i++) if (list[i] in known) return 1
            return 0
        }
        # Every part of an "and" holds. "A OR B AND C" without brackets is read as A or B, and C: too strict, never too lax.
        function holds(expression,    list, n, i) {
            n = split(expression, list, / AND /)
            for (i = 1; i <= n; i++) if (!one_of(list[i])) return 0
            return n > 0
        }
        BEGIN { n = split(allowed, names, " "); for (i = 1; i <= n; i++) known[names[i]] = 1 }
        !holds($1) { print "licence not allowed: " $2 ": " ($1 == "" ? "none" : $1); failed = 1 }
        END { print NR " crates checked"; if (NR == 0) failed = 1; exit failed }'
