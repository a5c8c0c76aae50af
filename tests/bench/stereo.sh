#!/usr/bin/env bash
# Stereo: made views beside photographed ones and beside what practitioners do; what other frames add to hidden
# background; speed. The tables of tests/bench/RENDERS.md.
#
# Usage: tests/bench/stereo.sh [DATA] [IMAGES]
#   DATA    holds multiview/{art,books,dolls,cones,tsukuba}; default: $DEPTHTWEEN_DATA, else ../shared/data
#   IMAGES  a folder for the pictures
# Builds into build/bench (release). About 2 minutes on 2 cores.
set -euo pipefail
cd "$(dirname "$0")/../.."
data=${1:-${DEPTHTWEEN_DATA:-../shared/data}}
build=build/bench
cmake -S . -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DDEPTHTWEEN_RPC=OFF >/dev/null
ninja -C "$build" stereo_bench >/dev/null
if [ -d "$data/multiview" ]; then
  "$build/bin/stereo_bench" views "$data" ${2:+"$2/views"}
else
  echo "no $data/multiview: photographed views are left out"
fi
echo
"$build/bin/stereo_bench" temporal ${2:+"$2/temporal"}
echo
"$build/bin/stereo_bench" speed
