// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "common/base/result.h"
#include "common/wire/participant.h"

namespace cairn {

/// Decides, while the server is silent, whether a session joins anew: when the server's or our own address is
/// another one than when it joined. Pure. One thread.
class PathWatch {
 public:
  struct Advice {
    bool join_anew = false;
    std::string text;  ///< for a person, each thing once; empty: nothing to say
  };

  /// `host`: the server as it was named; `joined`: the path in use.
  PathWatch(std::string host, wire::NetworkPath joined)
      : host_(std::move(host)), joined_(std::move(joined)) {}

  /// `now`: the path as it would be taken at this moment, or why there is none.
  [[nodiscard]] Advice compare(const Result<wire::NetworkPath>& now);
  /// A participant with this path has been made.
  void joined(const wire::NetworkPath& path) { joined_ = path; }
  /// None could be made: any path is worth joining on.
  void left() { joined_.reset(); }
  /// The server is heard again.
  void heard() { said_.clear(); }

 private:
  const std::string host_;
  std::optional<wire::NetworkPath> joined_;
  std::string said_;
};

}  // namespace cairn
