#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Sourced where the command is to run: two virtual buses with CAN FD, multicast on lo, and controllers where there are any.
ip link set lo up multicast on && ip route add 239.255.0.0/16 dev lo &&
  ip link add vcan0 type vcan && ip link set vcan0 mtu 72 up &&
  ip link add vcan1 type vcan && ip link set vcan1 mtu 72 up || return 1
# /sys may still show those of another namespace.
for controller in can0 can1; do
  ! grep -q "^ *$controller:" /proc/net/dev || ip link set "$controller" up type can bitrate 1000000 restart-ms 100 || return 1
done
