# shellcheck shell=bash
# What demo.sh and test.sh share. Source it; it moves to the root of the repository.

cd "$(dirname "${BASH_SOURCE[0]}")/.." || exit

say() { echo "$(basename "$0"): $*" >&2; }

# configure PRESET [CMAKE ARGUMENTS]: for this machine's processor where it is older than what the presets compile for.
configure() {
  local preset=$1 for_processor=()
  shift
  if [[ $(uname -m) == x86_64 ]] && ! grep -qw avx2 /proc/cpuinfo; then
    for_processor=(-DDEPTHTWEEN_CPU=native)
  fi
  cmake --preset "$preset" --log-level=WARNING "${for_processor[@]}" "$@"
}

# build PRESET [TARGET...]: everything when no target is named. Ninja counts its steps on a terminal only.
build() {
  local preset=$1 quiet=()
  shift
  [[ -t 1 ]] || quiet=(-- --quiet)
  (($#)) && set -- --target "$@"
  cmake --build --preset "$preset" "$@" "${quiet[@]}"
}
