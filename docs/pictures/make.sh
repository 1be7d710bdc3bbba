#!/usr/bin/env bash
# Makes the pictures of README and guide: docs/pictures/make.sh [RUN], with ImageMagick and what window.sh needs.
# RUN is a run of the bundled demo; without one, five minutes are trained first. NEIF names the program.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
assets=$here/../../assets
export NEIF=${NEIF:-neif}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
run=${1:-$work/run}
[[ -d $run ]] || "$NEIF" train "$assets/demo" --out "$run" --budget 300s --seed 1

# The light turned about the object, with few colours: a photo is the worst that a GIF can hold.
"$NEIF" render "$run" --turntable 16 --spin environment --size 200x200 --format gif --fps 8 --out "$work/light.gif"
convert "$work/light.gif" -coalesce +dither -colors 48 -fuzz 3% -layers OptimizeTransparency "$here/light.gif"

# A test photo of the capture, the same view as learned, rough, tinted, and in another environment.
edit() { "$NEIF" render "$run" --turntable 1 --cameras "$assets/demo/transforms_test.json" --size 240x240 --out "$work/$1" "${@:2}"; }
edit learned
edit rough --roughness 0.45
edit tinted --tint 1,0.55,0.3
edit elsewhere --env "$assets/environments/gallery.safetensors"
convert "$assets/demo/test/r_002.png" -resize 240x240 "$work/photo.png"
convert "$work/photo.png" "$work"/learned/*.png "$work"/rough/*.png "$work"/tinted/*.png "$work"/elsewhere/*.png +append -quality 90 "$here/edits.jpg"

"$here/window.sh" "$run"
