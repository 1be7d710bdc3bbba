#!/usr/bin/env bash
# Makes the README's pictures from a trained run: docs/pictures/make.sh RUN PHOTO.png OTHER_ENVIRONMENT, with ImageMagick.
set -euo pipefail
run=$1 photo=$2 other=$3
here=$(cd "$(dirname "$0")" && pwd)
neif=${NEIF:-neif}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# The light turned about the object.
"$neif" render "$run" --turntable 24 --spin environment --size 240x240 --format gif --fps 12 --out "$work/light"
cp "$work"/light/*.gif "$here/light.gif"

# A photo of the capture, the same view as learned, rough, tinted, and in another environment.
edit() { "$neif" render "$run" --turntable 1 --size 240x240 --out "$work/$1" "${@:2}"; }
edit learned
edit rough --roughness 0.45
edit tinted --tint 1,0.55,0.3
edit elsewhere --env "$other"
convert "$photo" -resize 240x240^ -gravity center -extent 240x240 "$work/photo.png"
convert "$work/photo.png" "$work"/learned/*.png "$work"/rough/*.png "$work"/tinted/*.png "$work"/elsewhere/*.png +append -quality 90 "$here/edits.jpg"
