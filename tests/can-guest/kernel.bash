# SPDX-License-Identifier: Apache-2.0
# Sourced by run-in-can-guest: Debian's kernel, unpacked and not installed, and an initial RAM disk with the modules of CAN.
# Wants `stop` and deploy/common.bash.

kernel_dir=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")" && pwd)
readonly cache=${CAIRN_CAN_GUEST_CACHE:-${XDG_CACHE_HOME:-${HOME:-/root}/.cache}/cairn-can-guest}
readonly modules=(virtio_pci virtio_console 9pnet_virtio 9p overlay can-raw vcan sch_netem)

# What the cache was made by: another one is made anew, of the package that is there.
kernel_recipe() { sha256sum "$kernel_dir/kernel.bash" "$kernel_dir/inside/init" | cut -d' ' -f1; }

kernel_is_ready() { [[ -s $cache/recipe && $(cat "$cache/recipe") == "$(kernel_recipe)" ]]; }

# download_kernel: the package that linux-image-amd64 stands for now, with the checksum of the archive's signed index. The cloud
# kernel has no CAN.
download_kernel() {
  local package
  package=$(apt-cache depends linux-image-amd64 2>/dev/null | sed -n 's/^ *Depends: \(linux-image-[0-9].*\)/\1/p')
  [[ -n $package ]] || return 1
  (cd -- "$cache" && apt-get -qq download "$package" 2>"$cache/apt.log")
}

# A package list that is out of date names a package that the archive no longer has.
fetch_kernel() {
  compgen -G "$cache/linux-image-*.deb" >/dev/null && return
  say "downloading Debian's kernel into $cache"
  download_kernel && return
  as_root apt-get update -qq >&2 || true
  download_kernel || stop "Debian's kernel could not be downloaded; are the network and Debian's mirror reachable? $(cat "$cache/apt.log" 2>/dev/null || echo 'apt knows no linux-image-amd64')"
}

# module_files TREE VERSION MODULE...: with what they need, in the order of loading.
module_files() {
  local tree=$1 version=$2 module
  shift 2
  for module in "$@"; do
    modprobe -d "$tree" -S "$version" --show-depends "$module" | sed -n 's/^insmod \([^ ]*\).*/\1/p'
  done | awk '!seen[$1]++'
}

make_initrd() {
  local tree=$1 version=$2 root=$1/initrd applet
  mkdir -p "$root"/{bin,modules,proc,sys,dev,low,control}
  cp /bin/busybox "$root/bin/"
  for applet in sh mount mkdir insmod poweroff switch_root cat; do ln -s busybox "$root/bin/$applet"; done
  module_files "$tree" "$version" "${modules[@]}" >"$tree/wanted"
  module_files "$tree" "$version" kvaser_pci >"$tree/wanted-kvaser"
  sort -u "$tree/wanted" "$tree/wanted-kvaser" | xargs -d '\n' cp -t "$root/modules"
  sed 's|.*/||' "$tree/wanted" >"$root/modules/list"
  sed 's|.*/||' "$tree/wanted-kvaser" >"$root/modules/kvaser"
  install -m 755 "$kernel_dir/inside/init" "$root/init"
  (cd -- "$root" && find . | cpio -o -H newc 2>/dev/null | gzip -1) >"$cache/initrd.gz"
}

# unpacked_image PACKED OUT: what the guest would else unpack at each start, in emulation (2.5 s). Where it is packed otherwise,
# the packed one boots as well.
unpacked_image() {
  local position
  cp -- "$1" "$2"
  position=$(LC_ALL=C grep -aobPm1 '\xFD7zXZ\x00' "$1" | head -n 1 | cut -d: -f1) || return 0
  tail -c "+$((position + 1))" "$1" | xz -dc >"$2.unpacked" 2>/dev/null || true  # the packed one has a tail
  if [[ $(head -c 4 "$2.unpacked" | tail -c 3) == ELF ]]; then mv -- "$2.unpacked" "$2"; else rm -f -- "$2.unpacked"; fi
}

# Leaves vmlinux and initrd.gz in the cache, made once.
prepare_kernel() {
  local tree version package
  mkdir -p -- "$cache" || stop "no folder $cache"
  exec 9>"$cache/lock"
  flock 9
  if ! kernel_is_ready; then
    fetch_kernel
    tree=$cache/tree
    rm -rf -- "$tree"  # of a try that was interrupted
    mkdir -- "$tree"
    for package in "$cache"/linux-image-*.deb; do
      dpkg-deb -x "$package" "$tree" || {
        rm -rf -- "$package" "$tree"
        stop "$package is damaged; the next try downloads it again"
      }
    done
    version=$(cd -- "$tree/lib/modules" && echo *)
    depmod -b "$tree" "$version"
    make_initrd "$tree" "$version"
    unpacked_image "$tree/boot/vmlinuz-$version" "$cache/vmlinux"
    rm -rf -- "$tree"
    kernel_recipe >"$cache/recipe"
    say "the guest has Linux $version"
  fi
  exec 9>&-
}
