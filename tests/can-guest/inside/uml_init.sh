#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# The first process of user-mode Linux, whose root is this machine's, read only: modules, a memory for what is written, the command.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t devtmpfs dev /dev
read -ra words </proc/cmdline
for word in "${words[@]}"; do [[ $word != cairn_control=* ]] || control=${word#*=}; done
modules=/usr/lib/uml/modules/$(uname -r)/kernel
for module in net/can/can net/can/can-raw drivers/net/can/dev/can-dev drivers/net/can/vcan fs/overlayfs/overlay; do
  insmod "$modules/$module.ko"
done

# The root has one place where something can be mounted for sure.
mount -t tmpfs -o size=75% tmpfs /mnt
mkdir /mnt/upper /mnt/work /mnt/root /mnt/control
mount -t overlay -o lowerdir=/,upperdir=/mnt/upper,workdir=/mnt/work overlay /mnt/root || halt -f
mount -t hostfs none /mnt/control -o "$control"
for place in proc sys dev; do mount --rbind /$place /mnt/root/$place; done
mkdir -p /mnt/root/dev/shm /mnt/root/dev/pts /mnt/root/run/can-guest
mount -t tmpfs -o mode=1777 tmpfs /mnt/root/dev/shm
mount -t devpts devpts /mnt/root/dev/pts
mount --bind /mnt/control /mnt/root/run/can-guest
ln -sfn /proc/self/fd /mnt/root/dev/fd
for stream in 0:stdin 1:stdout 2:stderr; do ln -sfn "/proc/self/fd/${stream%:*}" "/mnt/root/dev/${stream#*:}"; done
scratch=$(<"/mnt/control/scratch")
if [[ -n $scratch ]]; then
  mkdir -p "/mnt/root$scratch"
  mount -t hostfs none "/mnt/root$scratch" -o "$scratch"
fi

stty -F /dev/ttyS1 raw -echo
stty -F /dev/ttyS2 raw -echo
# shellcheck source=tests/can-guest/inside/interfaces.sh
if . /mnt/control/interfaces.sh >/dev/console 2>&1; then
  # A signal's frame keeps the lower half of the vector registers only: the C library is to use no others.
  export GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX512BW,-AVX512DQ,-AVX512CD
  chroot /mnt/root bash /run/can-guest/command </dev/null >/dev/ttyS1 2>/dev/ttyS2
  echo $? >/mnt/control/code.new
  stty -F /dev/ttyS1 -a >/dev/null # waits until all is written
  mv /mnt/control/code.new /mnt/control/code
fi
sync
halt -f
