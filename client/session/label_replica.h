// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <map>
#include <optional>

#include "common/base/time.h"
#include "common/map/label.h"
#include "common/wire/messages.h"

namespace cairn {

/// How long a server that serves a map again may take to name a label that it named before it went.
constexpr std::chrono::seconds kOrphanGrace{2};

/// A client's copy of the labels of one map. Labels stay while the server is away; those that it does not
/// name again when it is back were removed meanwhile. Pure: the time is handed in. Used from one thread.
class LabelReplica {
 public:
  void receive(wire::LabelMessage message);
  void removed(LabelId label);
  /// Nobody writes this label any more.
  void orphaned(LabelId label, MonotonicTime now);
  /// Nobody writes any of the labels any more: a reader that starts from now on is not told which have gone.
  void orphan_all(MonotonicTime now);
  /// Removes labels that the server has not named again in time; call it now and then. `served`: there is a
  /// writer of this map's labels.
  void update(MonotonicTime now, bool served);

  /// The labels of an epoch, null without any. The same list until something changes.
  [[nodiscard]] const LabelListPtr& list(Epoch epoch);

 private:
  struct Entry {
    Epoch epoch;
    Label label;
    std::optional<MonotonicTime> orphaned_at;
  };
  std::map<LabelId, Entry> labels_;
  std::optional<MonotonicTime> served_since_;
  bool changed_ = false;
  Epoch listed_epoch_;
  LabelListPtr list_;
};

}  // namespace cairn
