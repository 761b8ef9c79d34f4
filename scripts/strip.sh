#!/bin/sh
# Draws docs/pipelines.jpg, the strip of pictures at the head of README.md: a frame of each pipeline, with its name. Needs ImageMagick.
#   scripts/strip.sh [FATHOM]
set -eu
cd "$(dirname "$0")/.."
fathom=${1:-target/release/fathom}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

while read -r pipeline scene settings; do
    # shellcheck disable=SC2086
    "$fathom" render "$scene" --pipeline "$pipeline" --samples 4 --set view.width=320 --set view.height=240 $settings \
        -o "$folder/$pipeline.png" </dev/null
    set -- "$@" -label "$pipeline" "$folder/$pipeline.png"
done <<'PICTURES'
underwater tank
voxelize bunny_dry
volume_ao sponza
hsao dragon_dry
gtao tree
photon_tracing port
refraction glass_teapot
shadow_rays bunny_shadow
planar planar_pool
scalar_ao engine
PICTURES
[ "${1:-}" != "$fathom" ] || shift
montage -font DejaVu-Sans -pointsize 15 "$@" -tile 5x -geometry 200x150+4+4 -quality 85 docs/pipelines.jpg
ls -l docs/pipelines.jpg
