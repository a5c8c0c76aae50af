#!/bin/bash
# The table of README.md: our error beside the baselines' on the library's own scenes, which everybody can render.
#
#   tests/bench/scenes.sh [FOLDER_OF_PROGRAMS]      the default is build/release/bin; writes Markdown to standard output
#
# Each scene is what `synth SCENE` renders by default (33 colour frames at 240 fps, depth at 30 fps through the model of
# a time-of-flight sensor, 512x424, seed 1), scored against exact truth on the pixels that all methods fill.
set -euo pipefail

BIN=$(realpath "${1:-$(dirname "${BASH_SOURCE[0]}")/../../build/release/bin}")
readonly BIN SCENES=(kick bounce cloth turntable pan)
WORK=$(mktemp -d)
readonly WORK
trap 'rm -rf "$WORK"' EXIT

for scene in "${SCENES[@]}"; do
  {
    "$BIN/depthtween-core" synth "$scene" -o "$WORK/$scene"
    "$BIN/depthtween-core" upsample "$WORK/$scene" -o "$WORK/$scene.out"
    "$BIN/depthtween-core" evaluate "$WORK/$scene.out" --reference "$WORK/$scene" \
      --baselines hold,linear,flow-warp --json >"$WORK/$scene.json"
  } >&2
  rm -rf "${WORK:?}/$scene" "$WORK/$scene.out"
done

python3 - "$WORK" "${SCENES[@]}" <<'PYTHON'
import json
import math
import sys

work, scenes = sys.argv[1], sys.argv[2:]
methods = ["hold", "linear", "flow-warp", "ours"]
ratios = {"all": [], "edge_band": []}

print("| scene | " + " | ".join(methods) + " | ours / flow-warp | complete: ours, flow-warp |")
print("|---|" + "---:|" * (len(methods) + 2))
for scene in scenes:
    with open(f"{work}/{scene}.json", encoding="utf-8") as file:
        by_name = {method["name"]: method for method in json.load(file)["methods"]}

    def rmse(name, region):
        return by_name[name]["regions"][region]["rmse_mm"]

    for region, values in ratios.items():
        values.append(rmse("ours", region) / rmse("flow-warp", region))
    cells = [f"{rmse(name, 'all'):.0f} / {rmse(name, 'edge_band'):.0f}" for name in methods]
    complete = ", ".join(f"{100 * by_name[name]['completeness']:.1f} %" for name in ("ours", "flow-warp"))
    cells.append(f"{ratios['all'][-1]:.2f} / {ratios['edge_band'][-1]:.2f}")
    print(f"| {scene} | " + " | ".join(cells) + f" | {complete} |")


def geometric_mean(values):
    return math.exp(sum(map(math.log, values)) / len(values))


print("| geometric mean |" + " |" * len(methods) +
      f" **{geometric_mean(ratios['all']):.2f}** / {geometric_mean(ratios['edge_band']):.2f} | |")
PYTHON
