#!/bin/bash
# Judges the method by all its tables on everything at hand: builds depthtween-benchmark and runs it on the
# library's scenes and, if a folder is named, on every sequence folder below it.
#
#   deploy/benchmark.sh [DATA] [REPORT] [OPTIONS...]
#
#   DATA     a folder of sequence folders (rgb.txt, depth.txt, camera.json), or none; default: none
#   REPORT   where report.md, report.json, plots and strips go; default: benchmark-report
#   OPTIONS  more for `depthtween-benchmark`, such as --tables depth --baselines all
#
# Asks nothing; may be run again. About 20 minutes on two free cores without DATA.
set -euo pipefail

DATA=${1:-none} REPORT=${2:-benchmark-report}
shift $(($# < 2 ? $# : 2))
[[ $DATA == none ]] || DATA=$(realpath "$DATA")
REPORT=$(realpath --canonicalize-missing "$REPORT")
# shellcheck source-path=SCRIPTDIR
source "$(dirname "${BASH_SOURCE[0]}")/steps.sh"

deploy/install-packages.sh build test
configure bench
build bench depthtween-benchmark

SEQUENCES=()
if [[ $DATA != none ]]; then
  while IFS= read -r -d '' list; do SEQUENCES+=("$(dirname "$list")"); done \
    < <(find "$DATA" -maxdepth 4 -name rgb.txt -print0 | sort -z)
  ((${#SEQUENCES[@]})) || { say "no sequence folder (rgb.txt) below $DATA"; exit 2; }
fi
build/bench/bin/depthtween-benchmark "${SEQUENCES[@]}" -o "$REPORT" "$@"
