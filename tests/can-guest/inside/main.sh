#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# The guest with its root: devices, interfaces, the command, the end.
control=/run/can-guest
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin

mkdir -p /dev/shm /dev/pts
mount -t tmpfs -o mode=1777 tmpfs /dev/shm
mount -t devpts devpts /dev/pts
ln -sfn /proc/self/fd /dev/fd
for stream in 0:stdin 1:stdout 2:stderr; do ln -sfn "/proc/self/fd/${stream%:*}" "/dev/${stream#*:}"; done

# port NAME: the device of that virtual serial port.
port() {
  local folder
  for folder in /sys/class/virtio-ports/*; do
    [[ $(<"$folder/name") != "$1" ]] || echo "/dev/${folder##*/}"
  done
}

scratch=$(<"$control/scratch")
if [[ -n $scratch ]]; then
  mkdir -p "$scratch"
  mount -t 9p -o trans=virtio,version=9p2000.L,msize=512000,cache=mmap,access=client scratch "$scratch"
fi

# shellcheck source=tests/can-guest/inside/interfaces.sh
if . "$control/interfaces.sh" >/dev/console 2>&1; then
  bash "$control/command" </dev/null >"$(port out)" 2>"$(port err)"
  echo $? >"$control/code.new"
  mv "$control/code.new" "$control/code"
fi
[[ -z $scratch ]] || umount -l "$scratch"
sync
/bin/busybox poweroff -f
