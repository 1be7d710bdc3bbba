#!/usr/bin/env bash
# Makes the guide's pictures of the window: docs/pictures/window.sh RUN, a run of the bundled demo.
# Needs Xvfb, xdotool, ImageMagick and a Vulkan driver (lavapipe will do). The window is driven by mouse and keys, and waited for by
# the lines of its log, as in tests/window.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
neif=${NEIF:-neif}
width=1120 height=720
work=$(mktemp -d)
# What the pictures show: the folder for exports, and the name of the run.
home=/tmp/neif-home
run=$work/demo
log=$work/log
cp -r "$1" "$run"
rm -rf "$home"
mkdir -p "$home/.config/neif"
echo "window = [$width.0, $height.0]" > "$home/.config/neif/settings.toml"

Xvfb -displayfd 3 -nolisten tcp -screen 0 "${width}x${height}x24" 3> "$work/display" 2> /dev/null &
server=$!
window=
trap 'kill $window $server 2> /dev/null || true; rm -rf "$work" "$home"' EXIT
until [[ -s $work/display ]]; do sleep 0.1; done
export DISPLAY=:$(< "$work/display")

# Starts the window with what is named.
start() {
    : > "$log"
    env -u WAYLAND_DISPLAY -u WAYLAND_SOCKET -u XDG_CONFIG_HOME -u XDG_CACHE_HOME -u XDG_DATA_HOME -u XDG_RUNTIME_DIR \
        HOME="$home" NEIF_LOG=warn,neif=trace NO_COLOR=1 WINIT_X11_SCALE_FACTOR=1 "$neif" view "$1" 2> "$log" &
    window=$!
}

# Opens the run and waits for its picture.
open() {
    start "$run"
    settled 0
    xdotool search --name neif windowfocus
}

# Leaves as a person does: a window that is killed offers its session to the next one.
close() {
    xdotool key ctrl+q
    wait "$window" || true
    window=
}

mark() { wc -l < "$log"; }

# Whether a line matches, after a line of the log.
says() { grep -q -- "$2" < <(tail -n "+$(($1 + 1))" "$log"); }

# Waits for such a line.
await() {
    local end=$((SECONDS + 600))
    until says "$1" "$2"; do
        kill -0 "$window" 2> /dev/null || { tail -n 5 "$log" >&2; exit 1; }
        ((SECONDS < end)) || { echo "waited in vain for $2" >&2; exit 1; }
        sleep 0.2
    done
}

# Waits until the last picture after a line of the log has stayed for a while.
settled() {
    local from=$1
    while :; do
        await "$from" 'preview name=.*is_last=true'
        from=$(mark)
        sleep 3
        says "$from" 'preview name=' || break
    done
}

# Sets x and y to a point of a control: its name, and how far across and down it is, percent.
locate() {
    local line value
    line=$(grep -F " place name=\"$1\" " "$log" | tail -n 1)
    value() { sed -E "s/.* $1=([0-9.]+).*/\1/" <<< "$line"; }
    x=$(awk "BEGIN { printf \"%d\", $(value x) + ($2 / 100 - 0.5) * $(value width) }")
    y=$(awk "BEGIN { printf \"%d\", $(value y) + ($3 / 100 - 0.5) * $(value height) }")
}

click() { xdotool mousemove "$1" "$2" sleep 0.2 click 1; }

# Drags by so many pixels to the right, with a key held if one is named.
drag() {
    local x=$1 y=$2 by=$3 key=${4:-}
    xdotool mousemove "$x" "$y"
    [[ -z $key ]] || xdotool keydown "$key"
    xdotool mousedown 1
    for i in 1 2 3 4 5 6 7 8 9 10; do xdotool mousemove $((x + by * i / 10)) "$y" sleep 0.05; done
    xdotool mouseup 1
    [[ -z $key ]] || xdotool keyup "$key"
}

# Keeps what the window shows, without the pointer's traces.
keep() {
    xdotool mousemove $((width * 3 / 4)) 16 sleep 1
    import -window root png:- | convert png:- -strip -sampling-factor 4:2:0 -quality 40 "$here/window_$1.jpg"
}

# While training: the run goes on, from the list of commands.
open
xdotool key ctrl+k sleep 0.5 type 'train further'
xdotool sleep 0.5 key Return
from=$(mark)
await "$from" 'Progress('
sleep 20
keep training
close

# A part of the object made rougher; the button is above the slider.
open
locate viewport 41 64
click "$x" "$y"
sleep 5
locate Offset 34 50
click $((x - 105)) $((y - 100))
sleep 2
from=$(mark)
drag "$x" "$y" 20
settled "$from"
keep material
close

# The environment turned, with its handles.
open
locate viewport 20 20
from=$(mark)
drag "$x" "$y" 220 shift
xdotool key m
settled "$from"
keep environment
close

# The window for exports, set to a turntable.
open
xdotool key shift+F12
sleep 2
keep export
close

# An object without masks: the demo without what says where it is.
capture=$work/capture
cp -r "$here/../../assets/demo" "$capture"
rm -r "$capture"/mesh.glb "$capture"/*_mask
sed -i '/"mask_path"/d' "$capture"/transforms_*.json
start "$capture"
await 0 'elapsed_secs: 4[0-9]'
xdotool search --name neif windowfocus
locate 'Select the object…' 50 50
click "$x" "$y"
await 0 'place name="object photo"'
locate 'object photo' 50 50
click "$x" "$y"
await 0 'object found'
sleep 5
keep object
xdotool key ctrl+q
await 0 'place name="Close without saving"'
locate 'Close without saving' 50 50
click "$x" "$y"
wait "$window" || true
window=
