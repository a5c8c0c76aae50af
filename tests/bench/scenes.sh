#!/bin/bash
# The table of README.md: our error beside the baselines' on the library's own scenes, which anyone can render.
#
#   tests/bench/scenes.sh [FOLDER_OF_PROGRAMS]      the default is build/release/bin; writes Markdown to standard output
#
# Each scene is what `synth SCENE` renders by default (33 colour frames at 240 fps, depth at 30 fps through the model of
# a time-of-flight sensor, 512x424, seed 1), scored against exact truth on the pixels that all methods fill.
set -euo pipefail

BIN=$(realpath "${1:-$(dirname "${BASH_SOURCE[0]}")/../../build/release/bin}")
WORK=$(mktemp -d)
readonly BIN WORK
trap 'rm -rf "$WORK"' EXIT

"$BIN/depthtween-core" benchmark -o "$WORK" --tables depth --scenes all --baselines hold,linear,flow-warp >&2
grep -v '^!\[' "$WORK/report.md" | cat -s
