#!/bin/bash
# clang-tidy over our sources, with the checks of .clang-tidy. Takes minutes; for reviews, not in CI.
#
#   deploy/tidy.sh [REGEX]      only files whose path matches, such as core/io
set -euo pipefail

# shellcheck source-path=SCRIPTDIR
source "$(dirname "${BASH_SOURCE[0]}")/steps.sh"

deploy/install-packages.sh build test tidy
configure dev
build dev depthtween_proto  # the generated headers that sources include
run-clang-tidy -quiet -p build/dev "$PWD/(core|server|client)/.*${1:-}.*\.cc$"
