// SPDX-License-Identifier: Apache-2.0
#include "client/session/receiver.h"

/// Labels, and the server's word on what was asked about them.
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
  const std::scoped_lock lock(state_.mutex);
  if (std::find(state_.recent_maps.begin(), state_.recent_maps.end(), snapshot->map) !=
      state_.recent_maps.end())
    state_.labels[snapshot->map] = list;
}

void Receiver::act_on(const wire::ClientReply& reply) {
  const std::scoped_lock lock(state_.mutex);
  for (RequestReply& decided : state_.requests.apply(reply))
    state_.request_replies.push_back(std::move(decided));
  state_.for_sender.notify_one();  // there may be credit again
  state_.for_waiters.notify_all();
}

}  // namespace cairn
