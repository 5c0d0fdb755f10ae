#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# The other machine's files with a memory for what is written over them, as the root of the guest.
mkdir -p /memory /root2
mount -t tmpfs -o size=75% tmpfs /memory
mkdir /memory/upper /memory/work
mount -t overlay -o lowerdir=/low,upperdir=/memory/upper,workdir=/memory/work overlay /root2 || poweroff -f
for place in proc sys dev; do mount --move /$place /root2/$place; done
mkdir -p /root2/run/can-guest
mount --move /control /root2/run/can-guest
exec switch_root /root2 /bin/bash /run/can-guest/main.sh
