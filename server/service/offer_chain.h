// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>

#include "common/geometry/se3.h"
#include "common/map/ids.h"

namespace cairn {

/// Keeps where the frames that clients offered to a map are in it: a client that was cut off offers frames
/// each of which was tracked against the one before. Remembers so many of the last of a session of a client.
/// Pure; used from one thread.
class OfferChain {
 public:
  static constexpr size_t kRemembered = 256;  ///< offers of a client
  static constexpr size_t kMostClients = 64;

  struct Link {
    KeyframeId keyframe;
    SE3 camera_from_keyframe;
  };

  /// Notes where the frame of an offer is: it has become the keyframe of the link, or is relative to it.
  void put(const std::string& client, SessionId session, uint64_t command, const Link& link);
  /// The link of an offer; null: nothing is known of it, or not any more.
  [[nodiscard]] const Link* find(const std::string& client, SessionId session, uint64_t command) const;

 private:
  struct Session {
    SessionId session;
    std::map<uint64_t, Link> links;  ///< by command
    uint64_t last_put = 0;           ///< of puts_
  };
  std::map<std::string, Session> clients_;  ///< by name; who has been silent for longest gives way
  uint64_t puts_ = 0;
};

}  // namespace cairn
