#!/bin/bash
# Writes tests/golden/scenes.json anew: what the current version scores on small renderings of the library's scenes.
#
#   tests/golden/update.sh [FOLDER_OF_PROGRAMS]      the default is build/bench/bin (preset bench)
set -euo pipefail

BIN=$(realpath "${1:-$(dirname "${BASH_SOURCE[0]}")/../../build/bench/bin}")
HERE=$(realpath "$(dirname "${BASH_SOURCE[0]}")")
readonly BIN HERE
WORK=$(mktemp -d)
readonly WORK
trap 'rm -rf "$WORK"' EXIT

"$BIN/depthtween-benchmark" -o "$WORK" --tables depth --scenes all --baselines flow-warp --frames 17 --size 192x160
python3 - "$WORK/report.json" "$HERE/scenes.json" <<'PYTHON'
import json
import sys

PATHS = [f"/depth/methods/0/regions/{region}/rmse_mm"
         for region in ("all", "edge_band", "interior", "moving", "static", "disoccluded", "untextured")] + [
    "/depth/methods/0/regions/all/mae_mm",
    "/depth/methods/0/completeness",
    "/depth/methods/0/edges/f1",
    "/depth/methods/0/flicker_mm",
    "/depth/methods/0/uncertainty/mean_coverage_gap",
    "/depth/methods/1/regions/all/rmse_mm",
]


def at(value, path):
    for key in path.strip("/").split("/"):
        value = value[int(key)] if isinstance(value, list) else value.get(key, {})
    return value


with open(sys.argv[1], encoding="utf-8") as file:
    report = json.load(file)
scenes = {}
for clip in report["clips"]:
    numbers = {path: at(clip, path) for path in PATHS}
    scenes[clip["name"]] = {path: float(f"{number:.4g}") for path, number in numbers.items()
                            if isinstance(number, (int, float))}
golden = {"made_by": "tests/golden/update.sh", "frames": 17, "width": 192, "height": 160, "scenes": scenes}
with open(sys.argv[2], "w", encoding="utf-8") as file:
    json.dump(golden, file, indent=1)
    file.write("\n")
PYTHON
echo "$HERE/scenes.json"
