#!/usr/bin/env bash
# Depth of field: how close to a lens of 512 samples, what upsampled depth gains, and how fast. Prints Markdown.
#
# Usage: tests/bench/depth_of_field.sh [FOLDER]      FOLDER keeps the renders through the lens, which take most of the
#                                                    time, for the next run, and all pictures for the eye
# Builds into build/bench (release). About 20 minutes on 2 cores, 2 when FOLDER holds the references.
set -euo pipefail
cd "$(dirname "$0")/../.."
build=build/bench
cmake -S . -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DDEPTHTWEEN_RPC=OFF >/dev/null
ninja -C "$build" depth_of_field_bench >/dev/null
if [ $# -gt 0 ]; then mkdir -p "$1"; fi
for mode in quality upsampled; do
  "$build/bin/depth_of_field_bench" "$mode" "$@"
  echo
done
"$build/bin/depth_of_field_bench" speed
