#!/bin/bash
# clang-tidy over our sources, with the checks of .clang-tidy; any finding is an error.
#
#   deploy/tidy.sh               all of core, server and client: takes an hour
#   deploy/tidy.sh REGEX         those whose path matches, such as core/io
#   deploy/tidy.sh --recent N    the N that changed last, by the history of the checkout: what test.sh does
set -euo pipefail

# shellcheck source-path=SCRIPTDIR
source "$(dirname "${BASH_SOURCE[0]}")/steps.sh"

# The sources that changed last, newest first: not yet committed, then commit by commit. A header stands for its source.
recent_sources() {
  { git diff --name-only HEAD && git log --format= --name-only --max-count=100; } |
    sed -n 's/\.h$/.cc/; /^\(core\|server\|client\)\/.*\.cc$/p' | awk '!seen[$0]++' |
    while read -r file; do if [[ -f $file ]]; then echo "$file"; fi; done
}

deploy/install-packages.sh build test
if [[ ${1:-} == --recent ]]; then
  mapfile -t files < <(recent_sources | head -n "${2:?--recent needs a number: how many sources}")
  if ((${#files[@]} == 0)); then
    say "NOTHING IS CHECKED: the checkout has no history that tells what changed; for all: deploy/tidy.sh"
    exit 0
  fi
else
  mapfile -t files < <(find core server client -name '*.cc' | grep -E -- "${1:-.}" | sort)
fi

configure tidy
build tidy depthtween_proto_sources  # sources include the generated headers
printf '%s\n' "${files[@]}" |
  xargs --max-procs="$(nproc)" --max-args=1 clang-tidy --quiet -p build/tidy --warnings-as-errors='*' \
    2> >(grep -v ' generated\.$' >&2)  # counts of what was suppressed
echo "clang-tidy: ${#files[@]} sources, nothing found"
