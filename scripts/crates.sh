#!/bin/sh
# Prints the table of crates of ARCHITECTURE.md: each folder of `src`, with its lines of Rust and its crates.
# "own" are crates of this workspace that it stands on, "others" those that it is built with from elsewhere, both also indirectly.
set -euf
cd "$(dirname "$0")/.."

row() { # package, its folder, its sources
    tree=$(cargo tree --quiet --locked -p "$1" -e normal,build --prefix none --format '{p}' | sed 's/ (\*)$//' | sort -u)
    own=$(echo "$tree" | grep -c '^fathom' || true)
    all=$(echo "$tree" | wc -l)
    about=$(sed -n 's/^description = "\(.*\)"$/\1/p' "$2/Cargo.toml")
    echo "| \`$1\` | $(lines "$3") | $((own - 1)) | $((all - own)) | $about |"
}

lines() { # paths, apart by blanks
    # shellcheck disable=SC2086
    git ls-files $1 | xargs cat | wc -l
}

echo "| crate | lines | own | others | what |"
echo "|---|---|---|---|---|"
for folder in base scene record reference clock gpu stages pipelines verify experiments judge report harness compare history; do
    row "fathom-$folder" "src/$folder" "src/$folder/*.rs"
done
row fathom . "src/cli src/exporters.rs src/lib.rs src/main.rs"
