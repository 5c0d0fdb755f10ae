// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <csignal>
#include <memory>
#include <optional>
#include <string>

#include "common/base/log.h"
#include "common/base/result.h"
#include "server/endpoint/service.h"

namespace cairn {

/// Judges, now and then, whether a server is still reached where it was: its address may be taken from this
/// machine. Pure. One thread.
class OwnAddress {
 public:
  enum class Event : uint8_t {
    kNone,
    kGone,   ///< nothing is to be served on any more
    kMoved,  ///< there is another address
  };

  explicit OwnAddress(wire::NetworkPath in_use) : in_use_(std::move(in_use)) {}

  /// `is_here`: this machine has the address in use; `now`: where a server begun at this moment would be
  /// reached, if there is any place. Each state of affairs is told once.
  [[nodiscard]] Event look(bool is_here, const Result<wire::NetworkPath>& now);
  [[nodiscard]] const wire::NetworkPath& in_use() const { return in_use_; }

 private:
  wire::NetworkPath in_use_;
  std::optional<wire::NetworkPath> told_;  ///< the place last told; without address: there is none
};

/// Serves until one of the signals, which are blocked in all threads. When its interface has another address
/// meanwhile (where `listen` names an address, only that one will do), says so, and with a store begins anew
/// there: to clients a server that has been started again. `service`: running; null when it ended in vain
/// (the error) or a signal came in between. Whatever ends it, the caller closes the service.
[[nodiscard]] Status serve_until(const sigset_t& signals, const ServiceOptions& options,
                                 std::unique_ptr<Service>* service, const Logger& log);

}  // namespace cairn
