# SPDX-License-Identifier: Apache-2.0
# shellcheck disable=SC2154  # what it uses of run-in-can-guest is assigned there
# Sourced by run-in-can-guest: Debian's user-mode Linux, a kernel that runs as a process of this one. Programs run in it as fast as
# outside, on one processor; system calls take longer. There are virtual buses only.

uml_works() { command -v linux.uml gcc >/dev/null && compgen -G '/usr/lib/uml/modules/*/kernel/drivers/net/can/vcan.ko' >/dev/null; }

# Built beside the kept kernels: see uml_xstate.c.
build_uml_shim() {
  readonly uml_shim=$cache/uml_xstate.so
  mkdir -p -- "$cache"
  if [[ $uml_shim -nt $here/uml_xstate.c ]]; then return; fi
  gcc -O2 -shared -fPIC -o "$uml_shim.$$" "$here/uml_xstate.c" && mv -- "$uml_shim.$$" "$uml_shim"
}

run_uml() {
  local uml code=0
  build_uml_shim || stop "uml_xstate.c cannot be built (above)"
  printf '%s' "$scratch" >"$control/scratch"
  # stdout and stderr of the command are the kernel's serial lines 1 and 2; what the kernel says itself is kept.
  LD_PRELOAD=$uml_shim timeout -k 5 "$timeout" linux.uml "mem=${memory}M" rootfstype=hostfs rootflags=/ ro init="$control/uml_init.sh" \
    "cairn_control=$control" "uml_dir=$control/uml" umid=guest quiet con=null con0=null,fd:5 con1=null ssl=null ssl1=null,fd:3 ssl2=null,fd:4 \
    </dev/null 3>&1 4>&2 5>"$control/kernel.log" >"$control/uml.log" 2>&1 & uml=$!
  processes+=("$uml")
  wait "$uml" || code=$?
  processes=()
  [[ $code -ne 124 && $code -ne 137 ]] || die "$timed_out" "no end after $timeout s"
  if [[ -s $control/code ]]; then exit "$(cat "$control/code")"; fi
  tail -n 15 "$control/kernel.log" "$control/uml.log" >&2
  die "$no_guest" "the guest ended without a word of its command (linux.uml's exit code $code; its last words are above)"
}
