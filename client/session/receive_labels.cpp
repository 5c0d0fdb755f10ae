// SPDX-License-Identifier: Apache-2.0
#include "client/session/receiver.h"

/// Labels of a map.
namespace cairn {

void Receiver::take_labels(MapChannel& channel, ReceiverMemory::MapCopy& copy) {
  const MonotonicTime now = std::chrono::steady_clock::now();
  wire::take_all(channel.labels, [&](wire::Sample<wire::LabelMessage>& sample) {
    if (sample.message) {
      copy.labels.receive(std::move(*sample.message));
    } else if (sample.gone == wire::Gone::kDisposed) {
      copy.labels.removed(sample.key.label.id);
    } else {
      copy.labels.orphaned(sample.key.label.id, now);
    }
  });
  copy.labels.update(now, channel.labels.matched() > 0);
  const MapSnapshotPtr& snapshot = copy.replica.snapshot();
  if (snapshot == nullptr) return;
  const LabelListPtr& list = copy.labels.list(snapshot->epoch);
  core_.apply([&](SessionCore& core) { core.take_labels(snapshot->map, list); });
}

}  // namespace cairn
